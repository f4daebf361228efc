"""The error of `subset` beside that of OpenTURNS' SubsetSampling at equal calls, on known problems.

    pip install '.[peers]'
    python -m benchmarks.peers.openturns_beside [--calls 2000 10000] [--seeds 40]
        [--first-seed 1000] [--problems walk series]

Both run in this process, on the same functions, with the same seeds; tune with other ones
(--first-seed). An error is the root mean square of p ÷ P − 1, where a run that gives no number
counts as p = 0. Below 1, the ratio of the errors is in favour of `subset`. Its interval, of 90 %,
is the bootstrap's over the seeds: with 40 seeds a ratio is uncertain by a factor of about 1.4, with
200 by 1.2. A program that always prints 0 has the error 1. Where both errors are larger, neither
program estimates P at that budget, and the few runs that met failures decide the ratio: such rows
are marked, and left out of the two figures at the end. `python -m benchmarks.claims` finds these
with 600 seeds and 2,000 calls.

OpenTURNS has no budget: it takes the samples on a level, N, and goes on until failures are reached.
Its calls are the evaluations of the function that really happen, N on the first level and 0.9 N on
each further one. They differ from run to run, as the number of levels does. So N is chosen for each
problem such that the mean number of calls over 20 other seeds is the budget, within the rounding of
N to a multiple of 10; over the seeds that count it then differs by up to 5 %. The block is N ÷ 10,
one move of every chain; blocks of other sizes that divide it give the same estimates, and larger
ones shorten chains. All else is OpenTURNS' default: conditional probability 0.1, proposals of range
2. `subset` has the defaults of a campaign.
"""

import argparse
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from itertools import repeat
from typing import Any, NamedTuple

import numpy as np
from benchmarks.episode_pool import EpisodePool
from benchmarks.figures import Figure
from benchmarks.samples import COMMAND
from benchmarks.truth.intervals import Plan, estimate
from benchmarks.truth.known_problems import PROBLEMS, Noise, Problem
from msgspec.structs import replace
from numpy.typing import NDArray

from eigenfail_services.methods.subset import SubsetMethod

CALLS, SEEDS, FIRST_SEED = (2_000, 10_000), 40, 1_000
CALIBRATION_SEEDS, CALIBRATIONS = range(900, 920), 3
CLAIMED_CALLS, CLAIMED_SEEDS = 2_000, 600
LIKELY_LEVELS = 4
FEWEST_SAMPLES = 20
RESAMPLES = 2_000

Array = NDArray[np.float64]


class Runs(NamedTuple):
    """What the runs of one program on one problem gave, one value a seed, shape (seeds,).

    Attributes:
        ratios: estimate ÷ truth; 0 where there is no estimate.
        calls: evaluations of the function.
    """

    ratios: Array
    calls: Array

    @property
    def error(self) -> float:
        """Root mean square of the relative errors."""
        return find_error(self.ratios)


class Comparison(NamedTuple):
    """Runs of `subset` and of OpenTURNS on one problem at one budget."""

    problem: str
    budget: int
    subset: Runs
    openturns: Runs

    @property
    def ratio(self) -> float:
        """Error of `subset` ÷ error of OpenTURNS."""
        return self.subset.error / self.openturns.error

    @property
    def is_informative(self) -> bool:
        """Whether one of the errors is below that of printing 0."""
        return min(self.subset.error, self.openturns.error) < 1.0

    def find_interval(self) -> tuple[float, float]:
        """Return the 90 % bootstrap interval of the ratio, over seeds."""
        random = np.random.default_rng(0)
        seeds = len(self.subset.ratios)
        places = random.integers(0, seeds, (RESAMPLES, seeds))
        errors = [
            np.sqrt(np.square(one.ratios[places] - 1.0).mean(axis=1))
            for one in (self.subset, self.openturns)
        ]
        low, high = np.quantile(errors[0] / errors[1], (0.05, 0.95))
        return float(low), float(high)


class CallCounter:
    """A problem's robustness that counts how often it was evaluated."""

    def __init__(self, problem: Problem) -> None:
        self._robustness = problem.robustness
        self.calls = 0

    def __call__(self, z: Noise) -> Noise:
        self.calls += len(z)
        values: Noise = self._robustness(z)
        return values


def find_error(ratios: Array) -> float:
    """Return the root mean square of ratios to the truth, minus 1."""
    return float(np.sqrt(np.square(ratios - 1.0).mean()))


def run_subset(problem: Problem, budget: int, seeds: Sequence[int]) -> Runs:
    """Run a campaign of `subset` for each seed."""
    plan, ratios, calls = Plan(SubsetMethod, budget, {}, ()), [], []
    for seed in seeds:
        counter: Any = CallCounter(problem)
        told = estimate(plan, replace(problem, robustness=counter), seed)
        ratios.append((told.probability or 0.0) / problem.probability)
        calls.append(counter.calls)
    return Runs(np.array(ratios), np.array(calls, float))


def run_openturns(problem: Problem, samples: int, seeds: Sequence[int]) -> Runs:
    """Run OpenTURNS' SubsetSampling for each seed, with this number of samples on a level."""
    import openturns

    openturns.Log.Show(openturns.Log.NONE)
    values, counter = 2 * problem.steps, CallCounter(problem)

    def evaluate(sample: Any) -> Noise:
        z = np.asarray(sample)
        return counter(z.reshape(len(z), problem.steps, 2))[:, None]

    noise = openturns.RandomVector(openturns.Normal(values))
    function = openturns.PythonFunction(values, 1, func_sample=evaluate)
    robustness = openturns.CompositeRandomVector(function, noise)
    ratios, calls = [], []
    for seed in seeds:
        openturns.RandomGenerator.SetSeed(seed)
        failure = openturns.ThresholdEvent(robustness, openturns.LessOrEqual(), 0.0)
        sampling = openturns.SubsetSampling(failure)
        sampling.setConditionalProbability(0.1)
        sampling.setBlockSize(samples // 10)
        sampling.setMaximumOuterSampling(10)
        before = counter.calls
        try:
            sampling.run()
        except TypeError as error:
            # Where the last threshold is 0 by rounding, a level of share 1 follows. OpenTURNS then
            # has the estimate, but raises because its variance is NaN.
            if "variance" not in str(error):
                raise
        ratios.append(sampling.getProbabilityEstimatePerStep()[-1] / problem.probability)
        calls.append(counter.calls - before)
    return Runs(np.array(ratios), np.array(calls, float))


def choose_samples(problem: Problem, budget: int) -> int:
    """Return OpenTURNS' samples on a level with which its calls are the budget in the mean."""
    samples = budget / LIKELY_LEVELS
    for _ in range(CALIBRATIONS):
        calls = run_openturns(problem, _round_to_ten(samples), CALIBRATION_SEEDS).calls.mean()
        samples = _round_to_ten(samples) * budget / float(calls)
    return _round_to_ten(samples)


def _round_to_ten(samples: float) -> int:
    return max(10 * round(samples / 10.0), FEWEST_SAMPLES)


def compare(
    problems: Sequence[Problem], budgets: Sequence[int], seeds: Sequence[int]
) -> Iterator[Comparison]:
    """Yield the comparison of each problem at each budget."""
    for budget in budgets:
        for problem in problems:
            samples = choose_samples(problem, budget)
            yield Comparison(
                problem.name,
                budget,
                run_subset(problem, budget, seeds),
                run_openturns(problem, samples, seeds),
            )


def list_missing() -> tuple[str, ...]:
    """Return the package that the comparison needs, if it is not installed."""
    return () if find_spec("openturns") else ("openturns",)


def compare_problem(number: int, first_seed: int) -> Comparison:
    """Return the comparison that claims rest on, of the problem of this number."""
    seeds = range(first_seed, first_seed + CLAIMED_SEEDS)
    (one,) = compare([PROBLEMS[number]], [CLAIMED_CALLS], seeds)
    return one


def find_figures(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """The largest and the middle one of the ratios of the errors."""
    every = pool.each(compare_problem, range(len(PROBLEMS)), repeat(seed))
    told = sorted((one for one in every if one.is_informative), key=lambda one: one.ratio)
    worst = told[-1]
    low, high = worst.find_interval()
    counted = f"{CLAIMED_SEEDS} seeds on each of {len(told)} problems at {CLAIMED_CALLS} calls"
    notes = {
        "worst": (worst.ratio, f"{counted}; {worst.problem}, 90 % [{low:.2f}, {high:.2f}]"),
        "median": (float(np.median([one.ratio for one in told])), counted),
    }
    for name, (value, note) in notes.items():
        unit = "ratio of errors"
        figure = Figure(value=value, unit=unit, n=CLAIMED_SEEDS, command=COMMAND, note=note)
        yield f"subset_over_openturns_{name}", figure


NO_ESTIMATE = "  neither estimates P"
HEAD = (
    f"{'problem':30} budget  calls: subset OpenTURNS  error: subset OpenTURNS  ratio [90 %]"
    "         mean: subset OpenTURNS"
)


def format_row(one: Comparison) -> str:
    """Return a row of the table."""
    low, high = one.find_interval()
    calls = f"{one.subset.calls.mean():13.0f} {one.openturns.calls.mean():9.0f}"
    errors = f"{one.subset.error:13.2f} {one.openturns.error:9.2f}"
    means = f"{one.subset.ratios.mean():12.2f} {one.openturns.ratios.mean():9.2f}"
    ratio = f"{one.ratio:5.2f} [{low:4.2f}, {high:5.2f}]"
    mark = "" if one.is_informative else NO_ESTIMATE
    return f"{one.problem:30} {one.budget:6} {calls}  {errors}  {ratio:22} {means}{mark}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--calls", type=int, nargs="+", default=CALLS, help="budgets")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="number of seeds")
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED, help="the first of them")
    parser.add_argument("--problems", nargs="+", help="words in names; only problems with one")
    given = parser.parse_args()
    chosen = [
        problem
        for problem in PROBLEMS
        if not given.problems or any(word in problem.name for word in given.problems)
    ]
    seeds = range(given.first_seed, given.first_seed + given.seeds)
    print(HEAD)
    found = []
    for one in compare(chosen, given.calls, seeds):
        found.append(one)
        print(format_row(one), flush=True)
    ratios = [one.ratio for one in found if one.is_informative]
    print(f"neither estimates P: {len(found) - len(ratios)} of {len(found)}")
    if ratios:
        print(f"subset_over_openturns_worst {max(ratios):.2f}")
        print(f"subset_over_openturns_median {float(np.median(ratios)):.2f}")


if __name__ == "__main__":
    main()
