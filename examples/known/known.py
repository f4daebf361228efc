"""Functions of noise whose failure probability is known: examples/known/README.md.

P is under independent standard normal noise. It is exact (a closed form), or found by quadrature to
all digits given here; where neither is possible, it is an estimate with its error.
"""

from math import pi, sqrt
from statistics import NormalDist

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.functions import FunctionUnderTest, of_batch

Noise = NDArray[np.float64]
NORMAL = NormalDist()


class Problem(msgspec.Struct, frozen=True):
    """A function of noise, shape (n, steps, 2), with a known P(robustness <= 0)."""

    name: str
    steps: int
    probability: float
    robustness: FunctionUnderTest


def find_reach(probability: float) -> float:
    """Return the distance of a plane from the origin, with this probability beyond it. [sigma]"""
    return -NORMAL.inv_cdf(probability)


def flatten(z: Noise) -> Noise:
    """Return the noise as vectors, shape (n, 2 · steps)."""
    return z.reshape(len(z), -1)


def project(z: Noise) -> Noise:
    """Return the projection on the diagonal, a standard normal number, shape (n,)."""
    return flatten(z).sum(axis=1) / sqrt(z[0].size)


def one_axis(probability: float) -> Problem:
    """Beyond a bound of one number; the other one has no effect."""
    reach = find_reach(probability)
    border = of_batch(lambda z: reach - z[:, 0, 0])
    return Problem(f"one axis {probability:.0e}", 1, probability, border)


def half_space(probability: float, steps: int = 5) -> Problem:
    """Beyond a plane."""
    reach = find_reach(probability)
    border = of_batch(lambda z: reach - project(z))
    return Problem(f"half space {probability:.0e}, d = {2 * steps}", steps, probability, border)


def two_sided(probability: float, steps: int = 5) -> Problem:
    """Beyond either of two planes, on opposite sides of the origin."""
    reach = find_reach(probability / 2.0)
    border = of_batch(lambda z: reach - np.abs(project(z)))
    return Problem(f"two sides {probability:.0e}, d = {2 * steps}", steps, probability, border)


def two_half_spaces(probability: float, other: float) -> Problem:
    """Beyond either of two planes with different probabilities."""
    reach, behind = find_reach(probability), find_reach(other)

    def border(z: Noise) -> Noise:
        along = project(z)
        return np.minimum(reach - along, behind + along)

    name = f"two regions {probability:.0e} + {other:.0e}"
    return Problem(name, 5, probability + other, of_batch(border))


def four_half_spaces(probability: float) -> Problem:
    """Beyond any of four planes at right angles, each with the same probability."""
    reach = find_reach(probability)

    def border(z: Noise) -> Noise:
        sums = z.sum(axis=1) / sqrt(z.shape[1])
        return reach - np.abs(sums).max(axis=1)

    # The two axes are independent, so that exactly the corners would be counted twice.
    truth = 1.0 - (1.0 - 2.0 * probability) ** 2
    return Problem(f"four regions {probability:.0e} each", 5, truth, of_batch(border))


def outside_sphere(probability: float, radius: float, steps: int) -> Problem:
    """Outside a sphere: failures in every direction."""
    border = of_batch(lambda z: radius - np.linalg.norm(flatten(z), axis=1))
    return Problem(f"shell {probability:.0e}, d = {2 * steps}", steps, probability, border)


@of_batch
def two_corners(z: Noise) -> Noise:
    """Where |a| and b are both beyond 3; flat inside. P = 2 · Q(3)²."""
    return np.maximum(3.0 - np.minimum(np.abs(z[:, 0, 0]), z[:, 0, 1]), 0.0)


@of_batch
def four_branches(z: Noise) -> Noise:
    """A series system of two curved and two plane borders, with k = 7 (Waarts 2000)."""
    a, b = z[:, 0, 0], z[:, 0, 1]
    curved, plane = 3.0 + 0.1 * (a - b) ** 2, 7.0 / sqrt(2.0)
    along = (a + b) / sqrt(2.0)
    return np.minimum.reduce([curved - along, curved + along, a - b + plane, b - a + plane])


@of_batch
def rp22(z: Noise) -> Noise:
    """Problem 22 of the black-box reliability challenge: a curved border."""
    a, b = z[:, 0, 0], z[:, 0, 1]
    return 2.5 - (a + b) / sqrt(2.0) + 0.1 * (a - b) ** 2


@of_batch
def rp57(z: Noise) -> Noise:
    """Problem 57 of the same challenge: three borders, one of them a disc on the far side."""
    a, b = z[:, 0, 0], z[:, 0, 1]
    both = np.maximum(3.0 - a**2 + b**3, 2.0 - a - 8.0 * b)
    return np.minimum(both, (a + 3.0) ** 2 + (b + 3.0) ** 2 - 4.0)


@of_batch
def banana(z: Noise) -> Noise:
    """A bent region on both sides of an axis."""
    return 4.2 - z[:, 0, 0] - 0.35 * (z[:, 0, 1] ** 2 - 1.0)


@of_batch
def metaballs(z: Noise) -> Noise:
    """Near the origin the function falls fastest away from the failures (Breitung 2019)."""
    a, b = z[:, 0, 0], z[:, 0, 1]
    left = (4.0 * (a + 2.0) ** 2 / 9.0 + b**2 / 25.0) ** 2 + 1.0
    right = ((a - 2.5) ** 2 / 4.0 + (b - 0.5) ** 2 / 25.0) ** 2 + 1.0
    return 30.0 / left + 20.0 / right - 5.0


@of_batch
def rastrigin(z: Noise) -> Noise:
    """Many islands around the origin, on a grid of local extremes."""
    a = z[:, 0]
    return 20.0 - (a**2 - 5.0 * np.cos(2.0 * pi * a)).sum(axis=1)


@of_batch
def island(z: Noise) -> Noise:
    """A ball in four dimensions behind a ridge: close to it, robustness rises before it falls."""
    away = flatten(z).copy()
    away[:, 0] -= 4.5
    gap = np.linalg.norm(away, axis=1) - 1.5
    return gap * (1.0 + 1.5 * np.exp(-(((gap - 0.5) / 0.3) ** 2)))


@of_batch
def corner(z: Noise) -> Noise:
    """Where two planes at right angles are both passed: the sum of each of the two columns."""
    return find_reach(1e-2) - (z.sum(axis=1) / sqrt(z.shape[1])).min(axis=1)


@of_batch
def series(z: Noise) -> Noise:
    """Beyond any of eight planes in 40 dimensions; two normals have the cosine 0.3."""
    common, own = z[:, 0, 0], z[:, 1:17].reshape(len(z), 8, 4).sum(axis=2) / 2.0
    along = sqrt(0.3) * common[:, None] + sqrt(0.7) * own
    return 3.9 - along.max(axis=1)


@of_batch
def paraboloid(z: Noise) -> Noise:
    """A border in 100 dimensions that bends away from the origin in all of them."""
    others = np.square(flatten(z)[:, 1:])
    degrees = others.shape[1]
    return 5.0 - z[:, 0, 0] + (others.sum(axis=1) - degrees) / sqrt(2.0 * degrees)


@of_batch
def walk(z: Noise) -> Noise:
    """A random walk of 60 numbers that leaves a band on either side."""
    return 3.6 - np.abs(np.cumsum(flatten(z), axis=1)).max(axis=1) / sqrt(60.0)


@of_batch
def braking(z: Noise) -> Noise:
    """The largest error of a tracker that forgets, and loses measurements of large lateral noise.

    It is a leaky sum of the longitudinal noise.
    """
    error, largest = np.zeros(len(z)), np.zeros(len(z))
    for step in range(z.shape[1]):
        error = 0.9 * error + z[:, step, 0] * (np.abs(z[:, step, 1]) < 2.0)
        largest = np.maximum(largest, error)
    return 9.0 - largest


STEP_S = 0.2
DESIRED_GAP, GAP_GAIN, SPEED_GAIN = 6.6, 0.5, 1.0
GAP_NOISE, SPEED_NOISE = 2.0, 1.5
BRAKE = range(15, 25)
BRAKE_M_S2 = -3.0


@of_batch
def following(z: Noise) -> Noise:
    """The smallest gap to a car that brakes; the follower measures gap and speed with noise. [m]"""
    gap, speed = np.full(len(z), DESIRED_GAP), np.zeros(len(z))
    smallest = gap
    for step in range(z.shape[1]):
        measured = gap - DESIRED_GAP + GAP_NOISE * z[:, step, 0]
        closing = speed + SPEED_NOISE * z[:, step, 1]
        lead = BRAKE_M_S2 if step in BRAKE else 0.0
        speed = speed + STEP_S * (lead - GAP_GAIN * measured - SPEED_GAIN * closing)
        gap = gap + STEP_S * speed
        smallest = np.minimum(smallest, gap)
    return smallest


PROBLEMS = {
    "half_space_d1": one_axis(1e-4),
    "half_space_d40": half_space(1e-4, steps=20),
    "half_space_d200": half_space(1e-4, steps=100),
    "two_sides": two_sided(1e-4),
    "two_sides_d40": two_sided(1e-4, steps=20),
    "two_regions": two_half_spaces(1e-3, 1e-4),
    "four_regions": four_half_spaces(1e-3),
    "two_corners": Problem("two corners 4e-06", 1, 2.0 * NORMAL.cdf(-3.0) ** 2, two_corners),
    "four_branches": Problem("four branches", 1, 2.22279e-3, four_branches),
    "rp22": Problem("RP22", 1, 4.20730e-3, rp22),
    "rp57": Problem("RP57", 1, 2.82370e-2, rp57),
    "banana": Problem("banana", 1, 1.05481e-3, banana),
    "metaballs": Problem("metaballs", 1, 1.128558e-5, metaballs),
    "rastrigin": Problem("Rastrigin islands", 1, 5.370785e-4, rastrigin),
    "island": Problem("island, d = 4", 2, 1.797215e-4, island),
    "shell": outside_sphere(1e-4, 5.277910688521919, 3),
    "shell_d40": outside_sphere(1e-4, 9.058824086786549, 20),
    "corner": Problem("corner 1e-04, d = 20", 10, 1e-4, corner),
    "series": Problem("series of eight, d = 40", 20, 3.812525e-4, series),
    "paraboloid": Problem("paraboloid, d = 100", 50, 9.776796e-5, paraboloid),
    "walk": Problem("random walk, d = 60", 30, 4.903114e-4, walk),
    "braking": Problem("braking, d = 60", 30, 3.671306e-4, braking),
    "following": Problem("car following, d = 100", 50, 1.5884e-4, following),
}
"""The problems by the names of their functions, as campaigns give them."""

# Campaigns name functions of this module; these nine are made above.
half_space_d1 = PROBLEMS["half_space_d1"].robustness
half_space_d40 = PROBLEMS["half_space_d40"].robustness
half_space_d200 = PROBLEMS["half_space_d200"].robustness
two_sides = PROBLEMS["two_sides"].robustness
two_sides_d40 = PROBLEMS["two_sides_d40"].robustness
two_regions = PROBLEMS["two_regions"].robustness
four_regions = PROBLEMS["four_regions"].robustness
shell = PROBLEMS["shell"].robustness
shell_d40 = PROBLEMS["shell_d40"].robustness
