"""Regions of failures by what the ego does: which lie together, and how far they reach.

A point is the smoothed acceleration of the ego before the end of a failure, and the vehicle that
was struck. The distance of two points is a root mean square over the steps. [m/s²]
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenfail.values import Floats
from eigenfail_services.analysis.behaviour import (
    FEWEST_STRUCK,
    LEAST_STRUCK,
    RESOLUTION_MPS2,
    STRUCK_MPS2,
    smooth_accelerations,
)

Points = NDArray[np.float64]

DRAWS = 200
"""Bootstrap samples of the failures of a mode."""

INSIDE = 0.99
"""Share of the failures of a mode that are within its radius."""

FEWEST_FOR_RADIUS = 5
"""Failures from which on a mode has a radius of its own."""

APART, APART_OF_FEW = 3.7, 40.0
"""Distance of two centres, in standard deviations, from which on n failures are of two modes:
`APART` + `APART_OF_FEW` ÷ n. In 1 of 100 samples, halves of a uniform distribution are farther
apart, and those of a normal one in fewer."""

MOST_STEPS = 50
"""Iterations of Lloyd's algorithm."""


class ModeBehaviours(NamedTuple):
    """What the ego did in some failures of a mode, which stand for all of them.

    Attributes:
        accelerations: before the end of each, shape (failures, steps). [m/s²]
        struck: number of the vehicle that the ego collided with in each; empty if not known.
        failures: number of failures of the mode.
    """

    accelerations: Floats
    struck: tuple[int, ...]
    failures: int


class ModeRegion(NamedTuple):
    """The region of a mode.

    Attributes:
        centre: mean of its failures, shape (columns,). [m/s²]
        radius: distance from the centre within which failures belong to it. [m/s²]
    """

    centre: Points
    radius: float

    def measure(self, points: Points) -> Points:
        """Return the distance of points from the centre. [m/s²]"""
        distances: Points = np.linalg.norm(points - self.centre, axis=1)
        return distances


class FailureGroup(NamedTuple):
    """Failures of a release that lie together.

    Attributes:
        points: shape (failures, columns).
        failures: number of failures that these stand for.
        source: place of the release's mode that most of them belong to.
    """

    points: Points
    failures: float
    source: int


def list_clouds(releases: Sequence[Sequence[ModeBehaviours]], step_s: float) -> list[list[Points]]:
    """Return the failures of each mode of each release as points, shape (failures, columns).

    Args:
        releases: modes of each release.
        step_s: duration of a step. [s]
    """
    steps = max((mode.accelerations.shape[1] for each in releases for mode in each), default=0)
    vehicles = sorted(set[int]().union(*map(_find_frequent, releases)))
    return [[_make_points(mode, steps, vehicles, step_s) for mode in each] for each in releases]


def _find_frequent(modes: Iterable[ModeBehaviours]) -> set[int]:
    """Return the vehicles that enough failures of a release struck; see `FEWEST_STRUCK`."""
    counts = Counter(vehicle for mode in modes for vehicle in mode.struck)
    least = max(FEWEST_STRUCK, LEAST_STRUCK * counts.total())
    return {vehicle for vehicle, count in counts.items() if count >= least}


def _make_points(
    mode: ModeBehaviours, steps: int, vehicles: Sequence[int], step_s: float
) -> Points:
    # Accelerations end at the collision: a failure has none before its first step.
    missing = steps - mode.accelerations.shape[1]
    aligned = np.pad(mode.accelerations, ((0, 0), (missing, 0)))
    smooth = smooth_accelerations(aligned, step_s).astype(np.float64)
    struck = np.zeros((len(smooth), len(vehicles) + 1))
    for row, vehicle in enumerate(mode.struck):
        struck[row, vehicles.index(vehicle) if vehicle in vehicles else -1] = 1.0
    # In root mean square over the steps, as the resolution; see `STRUCK_MPS2`.
    return np.hstack([smooth / sqrt(max(steps, 1)), STRUCK_MPS2 / sqrt(2.0) * struck])


def separate_failures(
    clouds: Sequence[Points], modes: Sequence[ModeBehaviours]
) -> list[FailureGroup]:
    """Return the failures of a release by what lies apart from each other, the most first.

    The modes of an analysis are as many as its silhouette prefers: where there is one, it is often
    divided, and where one is far from the others, these are often one.

    Args:
        clouds: points of each mode of the release.
        modes: the modes.
    """
    pieces = [
        FailureGroup(part, mode.failures * len(part) / len(points), source)
        for source, (points, mode) in enumerate(zip(clouds, modes, strict=True))
        for part in _split(points)
    ]
    while (pair := _find_touching(pieces)) is not None:
        one, other = pair
        larger = max(pieces[one], pieces[other], key=lambda piece: piece.failures)
        merged = FailureGroup(
            np.concatenate([pieces[one].points, pieces[other].points]),
            pieces[one].failures + pieces[other].failures,
            larger.source,
        )
        rest = [piece for place, piece in enumerate(pieces) if place not in pair]
        pieces = [*rest, merged]
    return sorted(pieces, key=lambda piece: -piece.failures)


def _find_touching(pieces: Sequence[FailureGroup]) -> tuple[int, int] | None:
    """Return the places of the two pieces that are the least apart; None if all are apart."""
    gaps = {
        (one, other): _measure_gap(pieces[one].points, pieces[other].points)
        for other in range(len(pieces))
        for one in range(other)
    }
    nearest = min(gaps, key=gaps.__getitem__, default=None)
    return nearest if nearest is not None and gaps[nearest] < 1.0 else None


def _split(points: Points) -> list[Points]:
    """Return parts of failures that are apart, as far as halves along the longest axis show it."""
    if len(points) < 2 * FEWEST_FOR_RADIUS:
        return [points]
    centred = points - points.mean(axis=0)
    _, _, axes = np.linalg.svd(centred, full_matrices=False)
    is_left = centred @ axes[0] < 0.0
    for _ in range(MOST_STEPS):
        if not 0 < is_left.sum() < len(points):
            return [points]
        left, right = (points[side].mean(axis=0) for side in (is_left, ~is_left))
        before, is_left = (
            is_left,
            (np.linalg.norm(points - left, axis=1) < np.linalg.norm(points - right, axis=1)),
        )
        if (before == is_left).all():
            break
    one, other = points[is_left], points[~is_left]
    if min(len(one), len(other)) == 0 or _measure_gap(one, other) < 1.0:
        return [points]
    return [*_split(one), *_split(other)]


def _measure_gap(one: Points, other: Points) -> float:
    """Return the distance of two centres in units of that from which on they are of two modes."""
    line = other.mean(axis=0) - one.mean(axis=0)
    distance = float(np.linalg.norm(line))
    if distance == 0.0:
        return 0.0
    along = [(each - each.mean(axis=0)) @ line / distance for each in (one, other)]
    freedom = max(len(one) + len(other) - 2, 1)
    deviation = sqrt(sum(float(np.square(each).sum()) for each in along) / freedom)
    least = APART + APART_OF_FEW / (len(one) + len(other))
    return distance / (least * max(deviation, RESOLUTION_MPS2 / APART))


def _measure_spread(points: Points) -> float:
    """Return the distance of failures from the centres of bootstrap samples without them.

    Returns:
        The quantile `INSIDE` over all bootstrap samples. [m/s²]
    """
    drawn = np.random.default_rng(0).integers(len(points), size=(DRAWS, len(points)))
    weights = np.stack([np.bincount(row, minlength=len(points)) for row in drawn])
    centres = weights @ points / len(points)
    distances = np.linalg.norm(points[None] - centres[:, None], axis=2)
    return float(np.quantile(distances[weights == 0], INSIDE))


def find_usual_radius(clouds: Sequence[Points]) -> float:
    """Return the median radius of modes with enough failures, or else the resolution. [m/s²]"""
    radii = [_measure_spread(each) for each in clouds if len(each) >= FEWEST_FOR_RADIUS]
    return max(RESOLUTION_MPS2, float(np.median(radii)) if radii else 0.0)


def find_region(points: Points, usual: float) -> ModeRegion:
    """Return the region of a mode from its failures.

    Args:
        points: the failures, shape (failures, columns).
        usual: radius of a mode with too few failures for one of its own. [m/s²]
    """
    own = _measure_spread(points) if len(points) >= FEWEST_FOR_RADIUS else usual
    return ModeRegion(points.mean(axis=0), max(RESOLUTION_MPS2, own))
