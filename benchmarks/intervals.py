"""How often the failure probabilities that methods print hold the truth, on known problems.

`python benchmarks/intervals.py` runs 100 campaigns on each problem, method and budget; given names
of methods, those of these methods alone. It fails if, on any, fewer than 88 of 100 printed
intervals hold the truth (a lower bound must not exceed it by more than its own random error), if
the mean of the printed estimates is below 0.8 of the truth, or if fewer than 90 % of a method's
campaigns with a budget print a number, over all problems. `mixture` may refuse any number of them.
The limits of a problem hold for what is printed, where that is ten numbers or more. With several
failure regions importance sampling finds the share of the one that its proposal has found: its mean
shows how much a bound misses.
"""

import sys
from collections.abc import Iterator, Mapping, Sequence
from math import sqrt
from typing import Any

import msgspec
import numpy as np
from known_problems import PROBLEMS, Problem, half_space, two_half_spaces

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
from eigenfail_services.methods.mixture import MixtureMethod
from eigenfail_services.methods.subset import SubsetMethod
from eigenfail_services.statistics.intervals import log_normal

SEEDS = range(100, 200)
LEAST_HELD, LEAST_MEAN, LEAST_TOLD = 0.88, 0.8, 0.9
FEWEST_JUDGED = 10
SHIFTING = {"batch": 200, "mean_smoothing": 0.3, "min_std": 1.0, "max_mean": 3.0, "mean_window": 1}


class Plan(msgspec.Struct, frozen=True):
    """A method with its settings and budget, and the share of campaigns that must give a number."""

    method: Any
    episodes: int
    settings: dict[str, Any]
    problems: tuple[Problem, ...]
    least_told: float = LEAST_TOLD


class Verdict(msgspec.Struct, frozen=True):
    """How the campaigns of a plan did on a problem.

    Attributes:
        told: share of the campaigns that print a number.
        held: share of these whose interval, or bound, holds the truth.
        mean: mean of the printed numbers ÷ the truth.
        error: root mean square of their relative errors.
        is_bound: whether they are lower bounds, which may miss failures.
        is_judged: whether there are enough numbers to judge.
    """

    told: float
    held: float
    mean: float
    error: float
    is_bound: bool
    is_judged: bool

    def is_good(self) -> bool:
        """Return whether the limits of a problem are kept."""
        unbiased = self.is_bound or self.mean >= LEAST_MEAN
        return not self.is_judged or (self.held >= LEAST_HELD and unbiased)


class Engine:
    """Episodes of a problem."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem

    def add_policy(self, _policy: object) -> None:
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
    """Return the estimate of a whole campaign."""
    nothing = np.zeros((0, problem.steps, 2), np.float32)
    context = LearnerContext(learner_seed(seed), plan.episodes, problem.steps, nothing)
    given = read_settings(plan.method.Settings, plan.settings, "settings")
    learner: Learner = plan.method(context, given)
    rounds = Rounds(learner, seed, plan.episodes)
    for _ in run_in_process(rounds, Engine(problem)):
        pass
    told = rounds.estimate()
    if told is None:
        raise RuntimeError(f"{plan.method.__name__} gives no estimate at the end.")
    return told


def judge(found: Sequence[Estimate], truth: float) -> Verdict:
    """Return how the estimates of several campaigns compare with the truth."""
    told = [one for one in found if one.probability is not None and one.cv is not None]
    ratios = np.array([one.probability for one in told], float) / truth
    return Verdict(
        told=len(told) / len(found),
        held=float(np.mean([holds(one, truth) for one in told])) if told else 0.0,
        mean=float(ratios.mean()) if told else 0.0,
        error=sqrt(float(np.mean((ratios - 1.0) ** 2))) if told else 0.0,
        is_bound=any(one.bound is not None for one in told),
        is_judged=len(told) >= FEWEST_JUDGED,
    )


def holds(one: Estimate, truth: float) -> bool:
    """Whether an interval holds the truth, or a bound does not exceed it."""
    assert one.probability is not None
    assert one.cv is not None
    around = one.interval or log_normal(one.probability, one.cv)
    return around.low <= truth and (one.bound is not None or truth <= around.high)


TWO_REGIONS = (
    two_half_spaces(1e-3, 1e-3),
    two_half_spaces(1e-5, 1e-5),
    two_half_spaces(1e-3, 1e-4),
)
PLANS = (
    *(Plan(SubsetMethod, episodes, {}, PROBLEMS) for episodes in (2_000, 10_000)),
    *(Plan(MixtureMethod, episodes, {}, PROBLEMS, 0.0) for episodes in (2_000, 10_000)),
    Plan(
        CrossEntropyMethod,
        6_000,
        SHIFTING,
        (*(half_space(p) for p in (1e-3, 1e-4, 1e-5, 1e-6)), *TWO_REGIONS),
    ),
)


def compare_errors(verdicts: Mapping[tuple[str, int, str], Verdict]) -> float:
    """Return the median of the error of `mixture` ÷ that of `subset`, in up to 20 dimensions."""
    low = {problem.name for problem in PROBLEMS if 2 * problem.steps <= 20}
    mixture, subset = MixtureMethod.__name__, SubsetMethod.__name__
    ratios = [
        one.error / verdicts[subset, episodes, problem].error
        for (method, episodes, problem), one in verdicts.items()
        if method == mixture and problem in low and one.is_judged
    ]
    return float(np.median(ratios))


def main() -> None:
    chosen = [plan for plan in PLANS if plan.method.__name__ in sys.argv[1:]] or PLANS
    verdicts, poor = {}, []
    print(f"{'method, episodes, problem':50} told  held  mean  error")
    for plan in chosen:
        told: list[float] = []
        for problem in plan.problems:
            found = [estimate(plan, problem, seed) for seed in SEEDS]
            one = judge(found, problem.probability)
            place = plan.method.__name__, plan.episodes, problem.name
            name = f"{place[0]} {place[1]} {place[2]}"
            verdicts[place] = one
            poor += [] if one.is_good() else [name]
            figures = f"{one.told:4.2f}  {one.held:4.2f}  {one.mean:4.2f}  {one.error:4.2f}"
            print(f"{name:50} {figures}{' lower bound' * one.is_bound}", flush=True)
            told.append(one.told)
        share = np.mean(told)
        name = f"{plan.method.__name__} {plan.episodes}, all problems"
        poor += [] if share >= plan.least_told else [f"{name}: told {share:.2f}"]
    judged = [one for one in verdicts.values() if one.is_judged]
    estimates = [one for one in judged if not one.is_bound]
    print(f"intervals.covered_min {min(one.held for one in judged):.2f}")
    print(f"intervals.low_bias_worst {min(one.mean for one in estimates):.2f}")
    print(f"intervals.told_share {np.mean([one.told for one in verdicts.values()]):.3f}")
    if chosen is PLANS:
        print(f"mixture_over_subset {compare_errors(verdicts):.2f}")
    if poor:
        sys.exit("Beyond the limits:\n" + "\n".join(poor))


if __name__ == "__main__":
    main()
