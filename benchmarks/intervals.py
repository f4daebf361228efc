"""How often the failure probabilities that methods print hold the truth, on known answers.

`python benchmarks/intervals.py` runs 100 campaigns on each problem and fails if, on any, fewer than
90 of 100 intervals hold the truth; a campaign without a number counts as one that does not.
"""

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from math import sqrt
from statistics import NormalDist
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.contracts import Learner
from eigenfail.settings import read_settings
from eigenfail.values import (
    EpisodeResult,
    EpisodeTask,
    Estimate,
    LearnerContext,
    Measures,
    NoiseTrajectory,
    Outcome,
    TrajectorySource,
    learner_seed,
)
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.methods.cem.method import CrossEntropyMethod
from eigenfail_services.methods.subset.method import SubsetMethod

Noise = NDArray[np.float64]
SEEDS = range(100, 200)
NEEDED = 90
SHIFTING = {"batch": 200, "mean_smoothing": 0.3, "min_std": 1.0, "max_mean": 3.0, "mean_window": 1}


class Problem(msgspec.Struct, frozen=True):
    """Robustness as a function of noise, shape (n, steps, 2), with a known P(robustness <= 0)."""

    name: str
    steps: int
    probability: float
    robustness: Callable[[Noise], Noise]


class Plan(msgspec.Struct, frozen=True):
    """A method with its settings and budget."""

    method: Any
    episodes: int
    settings: dict[str, Any]
    problems: tuple[Problem, ...]


def half_space(probability: float) -> Problem:
    """Beyond a plane through noise of five steps."""
    reach = -NormalDist().inv_cdf(probability)
    return Problem(
        f"half space {probability:.0e}",
        5,
        probability,
        lambda z: reach - z.reshape(len(z), -1).sum(axis=1) / sqrt(z[0].size),
    )


def two_modes() -> Problem:
    """max(3 − min(|x1|, x2), 0): two corners, P = 2·Q(3)²."""
    return Problem(
        "two modes 4e-06",
        1,
        2.0 * NormalDist().cdf(-3.0) ** 2,
        lambda z: np.maximum(3.0 - np.minimum(np.abs(z[:, 0, 0]), z[:, 0, 1]), 0.0),
    )


class Engine:
    """Episodes of a problem."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem

    def learn(self, _policy: object) -> None:
        """There is no policy."""

    def run(self, tasks: Sequence[EpisodeTask]) -> Iterator[EpisodeResult]:
        noise = [task.source.z for task in tasks if isinstance(task.source, TrajectorySource)]
        values = self._problem.robustness(np.stack(noise).astype(np.float64))
        for task, z, value in zip(tasks, noise, values, strict=True):
            yield EpisodeResult(
                index=task.index,
                seed=task.seed,
                outcome=Outcome.SAFE if value > 0.0 else Outcome.COLLISION,
                steps=len(z),
                noise=NoiseTrajectory(z, np.ones_like(z)),
                source=task.source_kind,
                measures=Measures(max(float(value), 0.0)),
            )

    def close(self) -> None:
        """Nothing is held."""


def estimate(plan: Plan, problem: Problem, seed: int) -> Estimate:
    """What a whole campaign tells in the end."""
    nothing = np.zeros((0, problem.steps, 2), np.float32)
    context = LearnerContext(learner_seed(seed), plan.episodes, problem.steps, nothing)
    given = read_settings(plan.method.Settings, plan.settings, "settings")
    learner: Learner = plan.method(context, given)
    rounds = Rounds(learner, seed, plan.episodes)
    for _ in run_in_process(rounds, Engine(problem)):
        pass
    told = rounds.estimate()
    if told is None:
        raise RuntimeError(f"{plan.method.__name__} told nothing at the end.")
    return told


def verdict(told: Estimate, truth: float) -> str:
    """What became of a campaign."""
    if told.interval is None:
        return "refused"
    return "held" if told.interval.low <= truth <= told.interval.high else "missed"


HALF_SPACES = tuple(half_space(p) for p in (1e-3, 1e-4, 1e-5, 1e-6))
PLANS = (
    Plan(SubsetMethod, 12_000, {}, (*HALF_SPACES, two_modes())),
    Plan(CrossEntropyMethod, 6_000, SHIFTING, HALF_SPACES),
)


def main() -> None:
    poor = []
    for plan in PLANS:
        for problem in plan.problems:
            told = [verdict(estimate(plan, problem, s), problem.probability) for s in SEEDS]
            counts = Counter(told)
            line = f"{plan.method.__name__:20} {problem.name:18} " + ", ".join(
                f"{counts[word]:3} {word}" for word in ("held", "missed", "refused")
            )
            print(line, flush=True)
            if counts["held"] < NEEDED:
                poor.append(line)
    if poor:
        sys.exit(f"Fewer than {NEEDED} of {len(SEEDS)}:\n" + "\n".join(poor))


if __name__ == "__main__":
    main()
