"""Problems with a course: walks of known failure probability, with an importance at each step.

The walk is y_t = kept · y_(t-1) + z_t, of the noise of the first channel. It fails where it leaves
a band, or where it is beyond the wall after the last step. P is exact: a recursion over the density
of the walks that are still inside, on Gauss and Legendre's nodes.
"""

from collections.abc import Callable, Iterator, Sequence
from math import inf
from statistics import NormalDist

import msgspec
import numpy as np
from benchmarks.truth.known_problems import Noise

from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import (
    EpisodeResult,
    EpisodeTask,
    Outcome,
    PriorSource,
    TrajectorySource,
)
from eigenfail.values.measures import Measures

FAR, NODES = 40.0, 400
"""Lower end of a band without one, in units of the noise; nodes of the quadrature."""


class CourseProblem(msgspec.Struct, frozen=True):
    """A walk with a known failure probability.

    Attributes:
        kept: share of the last position that is kept.
        wall: position beyond which it fails.
        floor: position below which it fails; minus infinity without one.
        at_end: whether only the position after the last step counts.
        importance: importance at each step of positions, shape (n, steps).
    """

    name: str
    steps: int
    kept: float
    wall: float
    floor: float
    importance: Callable[[Noise], Noise]
    at_end: bool = False

    @property
    def probability(self) -> float:
        """P of a failure."""
        if self.at_end:
            variance = sum(self.kept ** (2 * step) for step in range(self.steps))
            return NormalDist(0.0, variance**0.5).cdf(-self.wall)
        return find_exit(self.kept, max(self.floor, -FAR), self.wall, self.steps)

    def walk(self, z: Noise) -> tuple[Noise, Noise]:
        """Return positions and failures at each step, shape (n, steps), of (n, steps, channels)."""
        y, places = np.zeros(len(z)), []
        for step in range(z.shape[1]):
            y = self.kept * y + z[:, step, 0]
            places.append(y)
        course = np.stack(places, axis=1)
        failed = (course > self.wall) | (course < self.floor)
        if self.at_end:
            failed[:, :-1] = False
        return course, failed


def find_exit(kept: float, low: float, high: float, steps: int) -> float:
    """Return the probability that a walk from 0 leaves a band within some steps."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    y = low + (high - low) * (nodes + 1.0) / 2.0
    weights = weights * (high - low) / 2.0

    def density(x: Noise) -> Noise:
        return np.exp(-0.5 * x**2) / np.sqrt(2.0 * np.pi)

    inside, kernel = density(y), density(y[:, None] - kept * y[None, :]) * weights
    for _ in range(steps - 1):
        inside = kernel @ inside
    return 1.0 - float(weights @ inside)


def add_ripple(y: Noise) -> Noise:
    """An importance that says little: it rises and falls with the time, whatever the position."""
    return y + 3.0 * np.sin(2.0 * np.arange(y.shape[1]))


COURSE_PROBLEMS = (
    CourseProblem("walk, both sides", 30, 1.0, 21.0, -21.0, np.abs),
    CourseProblem("walk, rarer", 30, 1.0, 25.5, -25.5, np.abs),
    CourseProblem("walk that forgets", 30, 0.9, 9.8, -inf, np.asarray),
    CourseProblem("walk, uneven importance", 12, 1.0, 11.0, -inf, add_ripple),
    CourseProblem("walk, end alone", 12, 0.8, 5.8, -inf, np.asarray, at_end=True),
)


class CourseEngine:
    """Episodes of a problem with a course."""

    def __init__(self, problem: CourseProblem) -> None:
        self._problem = problem

    def add_policy(self, _policy: object) -> None:
        """There is no policy."""

    def run(self, tasks: Sequence[EpisodeTask]) -> Iterator[EpisodeResult]:
        """Yield the results in the order of the tasks."""
        z = np.stack([self._find_noise(task) for task in tasks])
        course, failed = self._problem.walk(z.astype(np.float64))
        importance = self._problem.importance(course).astype(np.float32)
        has_failed = failed.any(axis=1)
        last = np.where(has_failed, failed.argmax(axis=1), z.shape[1] - 1)
        gaps = np.maximum(self._problem.wall - course.max(axis=1), 1e-3)
        for row, task in enumerate(tasks):
            end = int(last[row]) + 1
            noise = z[row, :end]
            yield EpisodeResult(
                index=task.index,
                seed=task.seed,
                outcome=Outcome.COLLISION if has_failed[row] else Outcome.SAFE,
                steps=end,
                noise=NoiseTrajectory(noise, np.ones_like(noise)),
                source=task.source_kind,
                measures=Measures(0.0 if has_failed[row] else float(gaps[row])),
                importance=importance[row, :end] if task.importance else None,
            )

    def _find_noise(self, task: EpisodeTask) -> np.ndarray:
        if isinstance(task.source, TrajectorySource):
            return np.asarray(task.source.z)
        assert isinstance(task.source, PriorSource)
        random = np.random.default_rng(task.seed)
        return random.standard_normal((self._problem.steps, 2), np.float32)

    def close(self) -> None:
        """Nothing is held."""
