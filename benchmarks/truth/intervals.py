"""How often the failure probabilities that methods print hold the truth, on known problems.

`python -m benchmarks.truth.intervals` runs 100 campaigns on each problem, method and budget; given
names of methods, those of these methods alone, and given budgets (`--episodes 2000`), those of
these budgets alone. It fails if, on any, fewer than 93 of 100 printed intervals hold the truth (a
lower bound must not exceed it by more than its own random error), if the mean of the printed
estimates is below 0.8 of the truth, or if fewer than 90 of 100 campaigns print a number. `mixture`
and `splitting` may refuse any number of them. The limits of coverage and mean hold where 20 numbers
or more are printed. With several failure regions importance sampling finds the share of the one
that its proposal has found: its mean shows how much a bound misses.

`--cut-in 10` runs so many campaigns of `splitting` on the scenario `cut_in`, 20,000 episodes each
(a CPU minute or more), and prints how many intervals hold its probability. They are too few to be
judged.
"""

import argparse
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from math import sqrt
from typing import Any, NamedTuple

import msgspec
import numpy as np
from benchmarks.episode_pool import EpisodePool, open_pool
from benchmarks.figures import Figure
from benchmarks.samples import COMMAND
from benchmarks.truth.course_problems import COURSE_PROBLEMS, CourseEngine, CourseProblem
from benchmarks.truth.known_problems import PROBLEMS, Problem, half_space, two_half_spaces
from benchmarks.truth.splitting import run_campaign

from eigenfail.contracts import Learner
from eigenfail.settings import read_settings
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import (
    EpisodeResult,
    EpisodeTask,
    Outcome,
    TrajectorySource,
    learner_seed,
)
from eigenfail.values.estimates import Estimate
from eigenfail.values.learning import LearnerContext
from eigenfail.values.measures import Measures
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.methods.cem import CrossEntropyMethod
from eigenfail_services.methods.ensemble import Ensemble
from eigenfail_services.methods.mixture import MixtureMethod
from eigenfail_services.methods.splitting import MultilevelSplitting
from eigenfail_services.methods.subset import SubsetMethod
from eigenfail_services.statistics.intervals import log_normal

SEEDS, FIRST_SEED = 100, 84_310_001
"""Seeds with which no setting and no rule was chosen. Those of `splitting` were chosen with the
seeds from 1000 on."""

LEAST_HELD, LEAST_MEAN, LEAST_TOLD = 0.93, 0.8, 0.9
FEWEST_JUDGED = 20
CUT_IN, CUT_IN_EPISODES = 3.38e-5, 20_000
"""P(failure) of `rulebook` in `cut_in`, from 197 failures of 5,825,000 plain episodes, with a 95 %
interval of [2.92, 3.89]e-5; and the budget of its campaigns."""

SHIFTING = {"batch": 200, "mean_smoothing": 0.3, "min_std": 1.0, "max_mean": 3.0, "mean_window": 1}


class Plan(msgspec.Struct, frozen=True):
    """A method with its settings and budget, and the share of campaigns that must give a number."""

    method: Any
    episodes: int
    settings: dict[str, Any]
    problems: tuple[Problem, ...] | tuple[CourseProblem, ...]
    least_told: float = LEAST_TOLD
    parallel: int | None = None


class Verdict(msgspec.Struct, frozen=True):
    """How the campaigns of a plan did on a problem.

    Attributes:
        told: share of the campaigns that print a number.
        held: share of these whose interval, or bound, holds the truth.
        mean: mean of the printed numbers ÷ the truth.
        error: root mean square of the relative errors of all campaigns; one without a number counts
            as an estimate of 0, whose error is 1.
        is_bound: whether they are lower bounds, which may miss failures.
        is_judged: whether there are enough numbers to judge.
    """

    told: float
    held: float
    mean: float
    error: float
    is_bound: bool
    is_judged: bool

    def is_good(self, least_told: float) -> bool:
        """Return whether all limits are kept."""
        unbiased = self.is_bound or self.mean >= LEAST_MEAN
        right = not self.is_judged or (self.held >= LEAST_HELD and unbiased)
        return self.told >= least_told and right


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


def make_engine(problem: Problem | CourseProblem) -> Engine | CourseEngine:
    """Return an engine for the episodes of a problem."""
    return CourseEngine(problem) if isinstance(problem, CourseProblem) else Engine(problem)


def estimate(plan: Plan, problem: Problem | CourseProblem, seed: int) -> Estimate:
    """Return the estimate of a whole campaign."""
    nothing = np.zeros((0, problem.steps, 2), np.float32)
    context = LearnerContext(
        learner_seed(seed), plan.episodes, problem.steps, nothing, parallel=plan.parallel
    )
    given = read_settings(plan.method.Settings, plan.settings, "settings")
    learner: Learner = plan.method(context, given)
    rounds = Rounds(learner, seed, plan.episodes)
    for _ in run_in_process(rounds, make_engine(problem)):
        pass
    told = rounds.estimate()
    if told is None:
        raise RuntimeError(f"{plan.method.__name__} gives no estimate at the end.")
    return told


def judge(found: Sequence[Estimate], truth: float) -> Verdict:
    """Return how the estimates of several campaigns compare with the truth."""
    told = [one for one in found if one.probability is not None and one.cv is not None]
    ratios = np.array([one.probability for one in told], float) / truth
    refused = np.zeros(len(found) - len(told))
    all_ratios = np.concatenate([ratios, refused])
    return Verdict(
        told=len(told) / len(found),
        held=float(np.mean([holds(one, truth) for one in told])) if told else 0.0,
        mean=float(ratios.mean()) if told else 0.0,
        error=sqrt(float(np.mean((all_ratios - 1.0) ** 2))),
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
    *(
        Plan(MultilevelSplitting, episodes, {}, COURSE_PROBLEMS, 0.0)
        for episodes in (3_200, 12_000)
    ),
    *(
        Plan(Ensemble, episodes, {"method": method, "members": members}, problems, 0.0)
        for method, members, episodes, problems in (
            ("subset", 4, 4_000, TWO_REGIONS),
            ("mixture", 4, 8_000, TWO_REGIONS),
            ("splitting", 2, 6_400, COURSE_PROBLEMS[:3]),
        )
    ),
)


class Place(NamedTuple):
    """A plan and a problem, by their numbers: functions do not go from process to process."""

    plan: int
    problem: int

    def describe(self) -> str:
        """Return the name in the table."""
        plan = PLANS[self.plan]
        members = f" of {plan.settings['method']}" if "method" in plan.settings else ""
        name = f"{plan.method.__name__}{members}"
        return f"{name} {plan.episodes} {plan.problems[self.problem].name}"


def judge_place(place: Place, pool: EpisodePool, seed: int) -> Verdict:
    """Run the campaigns of a plan on a problem."""
    seeds = range(seed, seed + SEEDS)
    found = pool.each(estimate_at, [place] * SEEDS, seeds)
    return judge(found, PLANS[place.plan].problems[place.problem].probability)


def estimate_at(place: Place, seed: int) -> Estimate:
    """Return the estimate of one campaign."""
    plan = PLANS[place.plan]
    return estimate(plan, plan.problems[place.problem], seed)


MOST_CLAIMED = 4_000
"""Budget up to which plans are run for claims: all of them take an hour of CPU time."""


def find_figures(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """The figures of the plans with small budgets."""
    chosen = [at for at, plan in enumerate(PLANS) if plan.episodes <= MOST_CLAIMED]
    yield from summarize(dict(judge_all(chosen, pool, seed)))


def find_splitting_figures(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """Figures of `splitting` on each problem, at its smallest budget."""
    chosen = [at for at, plan in enumerate(PLANS) if plan.method is MultilevelSplitting]
    for place, one in judge_all(chosen[:1], pool, seed):
        problem = PLANS[place.plan].problems[place.problem]
        name = f"intervals.splitting.{problem.name.replace(',', '').replace(' ', '_')}"
        told = round(one.told * SEEDS)
        note = f"campaigns of {PLANS[place.plan].episodes} episodes; P = {problem.probability:.3g}"
        make = partial(Figure, unit="share", command=COMMAND, note=note)
        yield f"{name}.told", make(value=one.told, n=SEEDS)
        yield f"{name}.held", make(value=one.held if told else None, n=told)


def judge_all(
    plans: Iterable[int], pool: EpisodePool, seed: int
) -> Iterator[tuple[Place, Verdict]]:
    """Judge plans on all of their problems, and print each verdict when it is known."""
    print(f"{'method, episodes, problem':50} told  held  mean  error")
    for plan in plans:
        for problem in range(len(PLANS[plan].problems)):
            place = Place(plan, problem)
            one = judge_place(place, pool, seed)
            figures = f"{one.told:4.2f}  {one.held:4.2f}  {one.mean:4.2f}  {one.error:4.2f}"
            print(f"{place.describe():50} {figures}{' lower bound' * one.is_bound}", flush=True)
            yield place, one


def summarize(verdicts: Mapping[Place, Verdict]) -> Iterator[tuple[str, Figure]]:
    """The worst of the verdicts, and what share of the campaigns printed a number."""
    make = partial(Figure, n=SEEDS, command=COMMAND)
    judged = {place: one for place, one in verdicts.items() if one.is_judged}
    estimates = {place: one for place, one in judged.items() if not one.is_bound}
    if judged:
        yield "intervals.covered_min", find_worst(judged, "held", "share")
    if estimates:
        yield "intervals.low_bias_worst", find_worst(estimates, "mean", "mean ÷ truth")
    told = float(np.mean([one.told for one in verdicts.values()]))
    note = f"of all campaigns, at {len(verdicts)} places"
    yield "intervals.told_share", make(value=told, unit="share", note=note)
    if ratios := compare_errors(verdicts):
        note = (
            f"median of {len(ratios)} problems of up to 20 dimensions and their budgets; a campaign"
            " without a number counts as an estimate of 0 on either side"
        )
        value = float(np.median(ratios))
        yield "intervals.mixture_over_subset", make(value=value, unit="ratio of errors", note=note)


def find_worst(judged: Mapping[Place, Verdict], name: str, unit: str) -> Figure:
    """Return the smallest value of a field of the verdicts, and where it was found."""
    values = {place: getattr(one, name) for place, one in judged.items()}
    worst = min(values, key=values.__getitem__)
    note = (
        f"{SEEDS} campaigns at each of {len(judged)} places (method, budget and problem) with "
        f"{FEWEST_JUDGED} numbers or more; the worst is {worst.describe()}"
    )
    return Figure(value=values[worst], unit=unit, n=SEEDS, command=COMMAND, note=note)


def compare_errors(verdicts: Mapping[Place, Verdict]) -> list[float]:
    """Return the errors of `mixture` ÷ those of `subset`, in up to 20 dimensions."""
    by_name = {
        (PLANS[place.plan].method, PLANS[place.plan].episodes, place.problem): one
        for place, one in verdicts.items()
    }
    return [
        one.error / by_name[SubsetMethod, episodes, problem].error
        for (method, episodes, problem), one in by_name.items()
        if method is MixtureMethod
        and 2 * PROBLEMS[problem].steps <= 20
        and (SubsetMethod, episodes, problem) in by_name
    ]


def list_faults(verdicts: Mapping[Place, Verdict]) -> list[str]:
    """Return the names of the places that are beyond a limit."""
    return [
        place.describe()
        for place, one in verdicts.items()
        if not one.is_good(PLANS[place.plan].least_told)
    ]


def judge_cut_in(pool: EpisodePool, campaigns: int) -> None:
    """Print the estimates of `splitting` on `cut_in`, and how many intervals hold the truth."""
    found = [
        run_campaign("cut_in", pool, FIRST_SEED + number, CUT_IN_EPISODES)
        for number in range(campaigns)
    ]
    for one in found:
        ends = one.interval and f"[{one.interval.low:.1e}, {one.interval.high:.1e}]"
        print(f"{one.by}: {one.probability} {ends} {one.problem}")
    told = [one for one in found if one.interval is not None]
    held = sum(holds(one, CUT_IN) for one in told)
    print(f"cut_in: {len(told)} of {campaigns} print an interval, {held} of these hold {CUT_IN}")


def main() -> None:
    names = sorted({plan.method.__name__ for plan in PLANS})
    parser = argparse.ArgumentParser(description="How often intervals hold the truth.")
    parser.add_argument("methods", nargs="*", help=f"of {', '.join(names)}; none given: all")
    parser.add_argument("--episodes", type=int, action="append", help="budgets; none given: all")
    parser.add_argument("--cut-in", type=int, default=0, help="campaigns of splitting on cut_in")
    given = parser.parse_args()
    if unknown := set(given.methods).difference(names):
        sys.exit(f"No method is named {', '.join(unknown)}; there are {', '.join(names)}.")
    chosen = [
        at
        for at, plan in enumerate(PLANS)
        if plan.method.__name__ in (given.methods or names)
        and plan.episodes in (given.episodes or [plan.episodes])
    ]
    with open_pool() as pool:
        if given.cut_in:
            judge_cut_in(pool, given.cut_in)
            return
        verdicts = dict(judge_all(chosen, pool, FIRST_SEED))
    for name, figure in summarize(verdicts):
        print(f"{name} {figure.value:.2f}: {figure.note}")
    if faults := list_faults(verdicts):
        sys.exit("Beyond the limits:\n" + "\n".join(faults))


if __name__ == "__main__":
    main()
