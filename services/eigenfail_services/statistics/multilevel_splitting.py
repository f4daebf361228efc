"""The probability of a rare failure by adaptive multilevel splitting, inside episodes.

A run holds n episodes. At each level, the episodes with the lowest maximum importance are given up,
at least a fixed share of them. Each of them is replaced by a continuation of another episode. The
continuation has the same noise up to the step after which the importance first exceeded the level,
and new noise from then on. Once enough episodes fail, P(failure) is estimated as (share kept at the
first level) · (share kept at the second) · … · (share of failures among the last episodes). It is
unbiased for any importance function, any n and any share, as long as all episodes at or below the
level are given up, ties included. A bad importance function costs variance. Source: Cérou and
Guyader 2007, Stochastic Analysis and Applications 25 (2), 417–443; unbiased: Bréhier, Gazeau,
Goudenège, Lelièvre and Rousset 2016, Annals of Applied Probability 26 (6), 3559–3601 (theorem 4.1).

The final failures descend from few of the first episodes. All failures that descend from one first
episode are a family. Families are nearly independent, so their effective number E, over all runs,
gives an error of sqrt(1 / E) (Lee and Whiteley 2018, Biometrika 105, 609–625). The differences
between the runs give a second error. If the importance function is imperfect, either error is too
small: if all of a few skewed runs miss the rare part, estimate and errors are too small together.
So both errors are added up. With a good importance function, this makes the interval too wide, by a
factor of up to sqrt(2) on the logarithmic scale.
"""

from collections.abc import Sequence
from math import ceil, exp, hypot, inf, log1p, sqrt
from statistics import fmean, stdev
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenfail.values.arrays import Floats
from eigenfail_services.statistics.batches import Array
from eigenfail_services.statistics.subset_estimate import count_effective


class SplittingCounts(NamedTuple):
    """Numbers of a run besides its arrays.

    Attributes:
        waves: number of completed waves.
        log_kept: logarithm of the product of the kept shares over all levels.
        unfaithful: number of continuations that stayed at or below the level, although the
            continued episode exceeded it: the simulation did not repeat itself.
    """

    waves: int = 0
    log_kept: float = 0.0
    unfaithful: int = 0


class SplittingWave(NamedTuple):
    """The next episodes of a run.

    Attributes:
        level: importance at or below which episodes were given up.
        rows: places of the given-up episodes in the run, shape (m,).
        z: noise of the replacing episodes, shape (m, steps, channels).
        courses: courses of the continued episodes up to the step that exceeds the level, and
            constant from then on; shape (m, steps).
        families: families of the continued episodes, shape (m,).
    """

    level: float
    rows: NDArray[np.intp]
    z: Floats
    courses: Floats
    families: NDArray[np.int64]


class SplittingRun:
    """One run: its present episodes, and the next episodes to run.

    All draws follow from the seed and the number of the wave, so arrays and counts are the whole
    state of a run.

    Attributes:
        z: noise of the present episodes, shape (n, steps, channels), float32.
        courses: largest importance so far after each step, shape (n, steps), float32; infinite from
            the collision on.
        families: number of the first episode that each episode descends from, shape (n,).
        counts: other numbers of the state.
        wave: episodes to be run next; None after the end.
        probability: estimate of P(failure); None before the end.

    Args:
        seed: seed of every draw.
        shape: number of episodes, of steps and of channels.
        given_up: minimum share of the episodes that is given up at a level.
    """

    def __init__(self, seed: Sequence[int], shape: tuple[int, int, int], given_up: float) -> None:
        self._seed = tuple(seed)
        self._given_up = given_up
        self.z: Floats = np.zeros(shape, np.float32)
        self.courses: Floats = np.full(shape[:2], -np.inf, np.float32)
        self.counts = SplittingCounts()
        self.probability: float | None = None
        rows = np.arange(shape[0])
        self.families: NDArray[np.int64] = rows.astype(np.int64)
        self.wave: SplittingWave | None = SplittingWave(
            -inf, rows, self._draw_noise(len(rows)), self.courses.copy(), self.families.copy()
        )

    def restore(
        self,
        z: Floats,
        courses: Floats,
        families: NDArray[np.int64],
        counts: SplittingCounts,
    ) -> None:
        """Continue from a state."""
        self.z, self.courses, self.families, self.counts = z, courses, families, counts
        if counts.waves:
            self.wave = self._choose_wave()

    def add(self, importances: Sequence[Floats | None], failed: Sequence[bool]) -> None:
        """Add the results of the wave, and choose the next episodes.

        Args:
            importances: importance after each step of each episode, shape (up to steps,). None for
                an errored episode, which counts as coming no closer to a collision.
            failed: whether each episode ended in a collision.
        """
        wave, counts, n = self.wave, self.counts, len(self.z)
        if wave is None:
            raise ValueError("the run has ended")
        self.z[wave.rows], self.courses[wave.rows] = wave.z, wave.courses
        self.families[wave.rows] = wave.families
        for row, importance, collided in zip(wave.rows, importances, failed, strict=True):
            if importance is not None:
                self.courses[row] = make_course(importance, collided, self.courses.shape[1])
        stayed = int(np.count_nonzero(self.courses[wave.rows, -1] <= wave.level))
        self.counts = SplittingCounts(
            counts.waves + 1,
            # The first wave fills the run: nothing was given up for it.
            counts.log_kept + (log1p(-len(wave.rows) / n) if counts.waves else 0.0),
            counts.unfaithful + (stayed if counts.waves else 0),
        )
        self.wave = self._choose_wave()

    def _choose_wave(self) -> SplittingWave | None:
        """Return continuations to replace the lowest episodes; end the run if none are possible."""
        highest = self.courses[:, -1].astype(np.float64)
        level = float(np.sort(highest)[ceil(self._given_up * len(highest)) - 1])
        if level == inf:
            self.probability = exp(self.counts.log_kept) * float(np.mean(highest == inf))
            return None
        remaining = np.flatnonzero(highest > level)
        if not len(remaining):
            self.probability = 0.0
            return None
        return self._continue_some(remaining, np.flatnonzero(highest <= level), level)

    def _continue_some(
        self, remaining: NDArray[np.intp], rows: NDArray[np.intp], level: float
    ) -> SplittingWave:
        random = np.random.default_rng([*self._seed, self.counts.waves, PARENTS])
        parents = random.choice(remaining, len(rows))
        courses = self.courses[parents]
        crossing = (courses > level).argmax(axis=1)
        # Up to the step that exceeded the level: a continuation begins above the level.
        is_common = np.arange(courses.shape[1]) <= crossing[:, None]
        reached = courses[np.arange(len(rows)), crossing]
        z = np.where(is_common[:, :, None], self.z[parents], self._draw_noise(len(rows)))
        courses = np.where(is_common, courses, reached[:, None])
        return SplittingWave(level, rows, z, courses, self.families[parents])

    def divide_by_families(self) -> Array | None:
        """Return the part of `probability` from each first episode's descendants, shape (n,).

        None before the end.
        """
        if self.probability is None:
            return None
        failures = self.families[self.courses[:, -1] == inf]
        counts = np.bincount(failures, minlength=len(self.z))
        return self.probability * counts / max(len(failures), 1)

    def _draw_noise(self, n: int) -> Floats:
        random = np.random.default_rng([*self._seed, self.counts.waves, NOISE])
        return random.standard_normal((n, *self.z.shape[1:]), np.float32)


NOISE, PARENTS = 1, 2
"""What numbers are drawn for, as part of their seed."""


def make_course(importance: Floats, collided: bool, steps: int) -> Floats:
    """Return the largest importance so far after each step, shape (steps,).

    Args:
        importance: importance after each step of the episode, shape (up to steps,).
        collided: whether the episode ended in a collision; the course is then infinite from its
            last step on.
        steps: length of the course, which is constant after the end of the episode.
    """
    course = np.full(steps, -np.inf, np.float32)
    course[: len(importance)] = np.nan_to_num(importance, nan=-np.inf, neginf=-np.inf)
    # Infinity is kept for collisions: an importance that grows without bound is no failure.
    course = np.minimum(np.maximum.accumulate(course), np.finfo(np.float32).max)
    if collided:
        course[max(len(importance) - 1, 0) :] = np.inf
    return course


class PooledRuns(NamedTuple):
    """Mean of independent runs.

    Attributes:
        probability: mean of the runs' estimates; runs that died out count as 0.
        cv: coefficient of variation of the mean. Its variance is the sum of the variance from the
            families and the variance from the differences between the runs. Infinite without a
            failure.
        families: effective number of the families of the failures, over all runs.
        reached: number of runs that reached failures.
    """

    probability: float
    cv: float
    families: float
    reached: int


def pool_runs(parts: Sequence[Array]) -> PooledRuns:
    """Return the mean of the estimates of at least two independent runs, with its variation.

    Args:
        parts: part of each run's estimate from the descendants of each first episode.
    """
    found = [float(one.sum()) for one in parts]
    mean = fmean(found)
    if not mean:
        return PooledRuns(0.0, inf, 0.0, 0)
    apart = stdev(found) / sqrt(len(found)) / mean
    families = count_effective(np.concatenate(parts))
    reached = sum(one > 0.0 for one in found)
    return PooledRuns(mean, hypot(apart, sqrt(1.0 / families)), families, reached)
