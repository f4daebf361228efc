"""Regions of failures by the ego's behaviour: groups of failures and their radius.

A point is the smoothed acceleration of the ego before the end of a failure, and the struck vehicle.
The distance of two points is a root mean square over the steps. [m/s²]
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import combinations
from math import isfinite, nan, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenfail.values.arrays import Floats
from eigenfail_services.analysis import behaviour

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
    """The ego's behaviour in some failures of a mode, which represent all its failures.

    Attributes:
        accelerations: accelerations before the end of each failure, shape (failures, steps). [m/s²]
        struck: number of the vehicle that the ego hit in each failure; empty if unknown.
        failures: number of failures of the mode.
    """

    accelerations: Floats
    struck: tuple[int, ...]
    failures: int


class ModeRegion(NamedTuple):
    """The region of a mode.

    Attributes:
        centre: mean of its failures, shape (columns,). [m/s²]
        radius: distance from the centre within which failures belong to the mode. [m/s²]
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
        failures: number of failures that the points represent.
        source: place of the release's mode that most of the failures belong to.
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
    least = max(behaviour.FEWEST_STRUCK, behaviour.LEAST_STRUCK * counts.total())
    return {vehicle for vehicle, count in counts.items() if count >= least}


def _make_points(
    mode: ModeBehaviours, steps: int, vehicles: Sequence[int], step_s: float
) -> Points:
    # Accelerations end at the collision: a failure has none before its first step.
    missing = steps - mode.accelerations.shape[1]
    aligned = np.pad(mode.accelerations, ((0, 0), (missing, 0)))
    smooth = behaviour.smooth_accelerations(aligned, step_s).astype(np.float64)
    struck = np.zeros((len(smooth), len(vehicles) + 1))
    for row, vehicle in enumerate(mode.struck):
        struck[row, vehicles.index(vehicle) if vehicle in vehicles else -1] = 1.0
    # In root mean square over the steps, as the resolution; see `STRUCK_MPS2`.
    return np.hstack([smooth / sqrt(max(steps, 1)), behaviour.STRUCK_MPS2 / sqrt(2.0) * struck])


def separate_failures(
    clouds: Sequence[Points], modes: Sequence[ModeBehaviours]
) -> list[FailureGroup]:
    """Return the separate groups of a release's failures, the largest first.

    An analysis has as many modes as its silhouette prefers. It often divides a single mode. If one
    mode is far from the others, the analysis often merges the others into one mode. So modes are
    split and merged here.

    Args:
        clouds: points of each mode of the release.
        modes: the modes.
    """
    pieces = [
        FailureGroup(part, mode.failures * len(part) / len(points), source)
        for source, (points, mode) in enumerate(zip(clouds, modes, strict=True))
        for part in _split(points)
    ]
    left = dict(enumerate(pieces))
    gaps = {
        (one, other): _measure_gap(left[one].points, left[other].points)
        for one, other in combinations(left, 2)
    }
    while gaps:
        nearest = min(gaps, key=gaps.__getitem__)
        if gaps[nearest] >= 1.0:
            break
        merged = _merge(*(left.pop(place) for place in nearest))
        gaps = {pair: gap for pair, gap in gaps.items() if not {*pair} & {*nearest}}
        number = max(nearest) + len(pieces)
        gaps |= {
            (place, number): _measure_gap(piece.points, merged.points)
            for place, piece in left.items()
        }
        left[number] = merged
    return sorted(left.values(), key=lambda piece: -piece.failures)


def _merge(one: FailureGroup, other: FailureGroup) -> FailureGroup:
    larger = max(one, other, key=lambda piece: piece.failures)
    points = np.concatenate([one.points, other.points])
    return FailureGroup(points, one.failures + other.failures, larger.source)


def _split(points: Points) -> list[Points]:
    """Return the parts of failures that are apart, found by halving along the longest axis."""
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
    """Return the distance of two centres, relative to the least distance of two modes."""
    line = other.mean(axis=0) - one.mean(axis=0)
    distance = float(np.linalg.norm(line))
    if distance == 0.0:
        return 0.0
    along = [(each - each.mean(axis=0)) @ line / distance for each in (one, other)]
    freedom = max(len(one) + len(other) - 2, 1)
    deviation = sqrt(sum(float(np.square(each).sum()) for each in along) / freedom)
    least = APART + APART_OF_FEW / (len(one) + len(other))
    # Failures that are all alike have no deviation; what is within the resolution is one mode.
    return distance / (least * max(deviation, behaviour.RESOLUTION_MPS2 / APART))


def measure_spread(points: Points) -> float:
    """Return the distance of failures from the centres of bootstrap samples that omit them.

    Returns:
        The quantile `INSIDE` over all bootstrap samples; not a number if there are fewer
        failures than `FEWEST_FOR_RADIUS`. [m/s²]
    """
    if len(points) < FEWEST_FOR_RADIUS:
        return nan
    count = len(points)
    drawn = np.random.default_rng(0).integers(count, size=(DRAWS, count))
    weights = np.stack([np.bincount(row, minlength=count) for row in drawn])
    centred = points - points.mean(axis=0)
    # |p - c|² = |p|² - 2 p·c + |c|², where a centre c is a weighted mean of the points.
    products = centred @ centred.T
    to_centres = weights @ products / count
    own = np.einsum("dp,dp->d", to_centres, weights) / count
    squares = np.diag(products)[None] - 2.0 * to_centres + own[:, None]
    distances = np.sqrt(np.maximum(squares, 0.0))
    return float(np.quantile(distances[weights == 0], INSIDE))


def find_usual_radius(spreads: Sequence[float]) -> float:
    """Return the median of the known spreads, but at least the resolution. [m/s²]"""
    radii = [each for each in spreads if isfinite(each)]
    return max(behaviour.RESOLUTION_MPS2, float(np.median(radii)) if radii else 0.0)


def find_region(points: Points, spread: float, usual: float) -> ModeRegion:
    """Return the region of a mode from its failures.

    Args:
        points: the failures, shape (failures, columns).
        spread: their spread, as `measure_spread` returns it. [m/s²]
        usual: radius for modes with too few failures to estimate their radius. [m/s²]
    """
    own = spread if isfinite(spread) else usual
    return ModeRegion(points.mean(axis=0), max(behaviour.RESOLUTION_MPS2, own))
