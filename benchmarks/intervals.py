"""How often the failure probabilities that methods print hold the truth, on known answers.

`python benchmarks/intervals.py` runs 100 campaigns on each problem and fails if, on any, fewer than
90 of 100 statements hold: an interval must contain the truth, a lower bound must not exceed it by
more than its own random error. A campaign without a number counts as one that does not hold. The
median of the printed value ÷ the truth shows how much of it a lower bound misses: with several
failure regions importance sampling tells the share of the one that its proposal has found.
"""

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from math import sqrt
from statistics import NormalDist, median
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
from eigenfail_services.methods.cem import CrossEntropyMethod
from eigenfail_services.methods.subset import SubsetMethod
from eigenfail_services.statistics.intervals import log_normal

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


def two_half_spaces(probability: float, other: float) -> Problem:
    """Beyond either of two planes, on opposite sides of the origin."""
    reach, behind = (-NormalDist().inv_cdf(each) for each in (probability, other))

    def robustness(z: Noise) -> Noise:
        along = z.reshape(len(z), -1).sum(axis=1) / sqrt(z[0].size)
        return np.minimum(reach - along, behind + along)

    truth = probability + other
    return Problem(f"two regions {probability:.0e} + {other:.0e}", 5, truth, robustness)


def four_half_spaces(probability: float) -> Problem:
    """Beyond any of four planes at right angles, each with the same probability."""
    reach = -NormalDist().inv_cdf(probability)

    def robustness(z: Noise) -> Noise:
        sums = z.sum(axis=1) / sqrt(z.shape[1])
        return reach - np.abs(sums).max(axis=1)

    # The two axes are independent, so that exactly the corners would be counted twice.
    truth = 1.0 - (1.0 - 2.0 * probability) ** 2
    return Problem(f"four regions {probability:.0e} each", 5, truth, robustness)


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
    if told.probability is None or told.cv is None:
        return "refused"
    around = told.interval or log_normal(told.probability, told.cv)
    below = told.bound is not None or truth <= around.high
    return "held" if around.low <= truth and below else "missed"


def share_told(told: Sequence[Estimate], truth: float) -> str:
    """The median of the printed values ÷ the truth."""
    shares = [one.probability / truth for one in told if one.probability is not None]
    kinds = {one.bound for one in told if one.probability is not None}
    words = "lower bounds" if kinds == {"lower"} else "estimates"
    return f"{words} of {median(shares):.2f} of the truth" if shares else "no number"


HALF_SPACES = tuple(half_space(p) for p in (1e-3, 1e-4, 1e-5, 1e-6))
TWO_REGIONS = (
    two_half_spaces(1e-3, 1e-3),
    two_half_spaces(1e-5, 1e-5),
    two_half_spaces(1e-3, 1e-4),
)
PLANS = (
    Plan(
        SubsetMethod, 12_000, {}, (*HALF_SPACES, two_modes(), *TWO_REGIONS, four_half_spaces(1e-3))
    ),
    Plan(CrossEntropyMethod, 6_000, SHIFTING, (*HALF_SPACES, *TWO_REGIONS)),
)


def main() -> None:
    poor = []
    for plan in PLANS:
        for problem in plan.problems:
            told = [estimate(plan, problem, seed) for seed in SEEDS]
            counts = Counter(verdict(one, problem.probability) for one in told)
            held = ", ".join(f"{counts[word]:3} {word}" for word in ("held", "missed", "refused"))
            share = share_told(told, problem.probability)
            line = f"{plan.method.__name__:20} {problem.name:24} {held}; {share}"
            print(line, flush=True)
            if counts["held"] < NEEDED:
                poor.append(line)
    if poor:
        sys.exit(f"Fewer than {NEEDED} of {len(SEEDS)}:\n" + "\n".join(poor))


if __name__ == "__main__":
    main()
