"""Figures: how often the intervals that `eigenfail risk` states hold the true rate of failures.

A suite is made up: scenarios with a true rate of encounters and a true P(failure), a log of driving
with a Poisson number of encounters or a stated rate with its interval, and a campaign of each
scenario: Monte Carlo with a fixed number of episodes or with a stop rule on failures, or the mean
of a few independent runs with log-normal errors, as subset simulation states it. A stated rate is
the true one times a log-normal error without bias in its median. In half of the suites all
campaigns of Monte Carlo have one seed: their episodes of equal index fail together as often as they
can. `risk.cover` is the share of suites whose two-sided interval holds the truth,
`risk.cover.at_least` and `risk.cover.at_most` are those of the one-sided bounds, `risk.monotone` is
the share in which none of three scenarios can be left out so that a bound becomes larger,
`risk.renamed` by how much other names of the scenarios change the bound that they change most, and
`risk.zero_failures` the number of scenarios without a failure in all suites.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import exp, log, sqrt
from typing import NamedTuple

import numpy as np
from benchmarks.episode_pool import EpisodePool
from benchmarks.figures import Figure
from benchmarks.samples import COMMAND, count_share, median, share
from benchmarks.targets import Target
from numpy.typing import NDArray

from eigenfail.intervals import Z
from eigenfail.values.estimates import Estimate
from eigenfail_assurance.risk import confidence
from eigenfail_services.statistics.intervals import confidence_sequence, log_normal
from eigenfail_services.statistics.stopped_trials import StoppedTrials

SUITES = 400
MOST_SCENARIOS = 100
LEFT_OUT = 3
HOURS = (20.0, 5_000.0)
RATES = (1e-3, 10.0)
PROBABILITIES = (1e-6, 0.3)
EPISODES = (100, 100_000)
RUN_ERRORS = (0.05, 0.8)
RUNS = (2, 10)
WIDTHS = (1.2, 4.0)
"""Factors between a stated rate and the ends of its interval."""

FAILURES_TO_STOP = (2, 10)
HALF_WIDTHS = (0.3, 1.0)
"""Half-width of a confidence sequence at which its rule stops, in units of P(failure)."""

FEW = 10
"""Most scenarios of a small suite."""

ROUNDING = 1e-12
"""Relative error of a sum in another order."""


class SuiteCheck(NamedTuple):
    """How the bounds of a suite compare with its true rate.

    Attributes:
        covered: whether the two-sided interval holds it.
        below_at_most: whether it is at or below the one-sided upper bound.
        above_at_least: whether it is at or above the one-sided lower bound.
        monotone: whether no bound is lower than that of the suite without one of its scenarios.
        zeros: number of scenarios without a failure.
        scenarios: their number.
        renamed: largest relative change of a bound by other names of the scenarios.
        ratio: upper end of the interval ÷ the true rate.
    """

    covered: bool
    below_at_most: bool
    above_at_least: bool
    monotone: bool
    zeros: int
    ratio: float
    scenarios: int
    renamed: float


def find_cover(pool: EpisodePool, seed: int) -> Iterator[tuple[str, Figure]]:
    """How often intervals and bounds hold, and whether they are monotone."""
    found = pool.each(check_suite, range(seed, seed + SUITES))
    note = f"1 to {MOST_SCENARIOS} scenarios, with 2 to 10 runs or 100 to 100000 episodes each"
    yield "risk.cover", share([each.covered for each in found], note)
    yield "risk.cover.at_most", share([each.below_at_most for each in found], note)
    yield "risk.cover.at_least", share([each.above_at_least for each in found], note)
    few = [each.above_at_least for each in found if each.scenarios <= FEW]
    many = [each.above_at_least for each in found if each.scenarios > FEW]
    yield "risk.cover.at_least.few", share(few, f"at most {FEW} scenarios")
    yield "risk.cover.at_least.many", share(many, f"more than {FEW} scenarios")
    yield "risk.monotone", count_share([each.monotone for each in found], note)
    yield "risk.high_over_truth", median([each.ratio for each in found], "ratio", note)
    yield "risk.renamed", median([each.renamed for each in found], "relative change", note)
    zeros = float(sum(each.zeros for each in found))
    yield (
        "risk.zero_failures",
        Figure(value=zeros, unit="scenarios", n=SUITES, note=note, command=COMMAND),
    )


def check_suite(seed: int) -> SuiteCheck:
    """Return how a made-up suite does."""
    generator = np.random.default_rng([seed, 22])
    terms, truth = make_suite(generator)
    whole = confidence.bound_sum(terms)
    left_out = generator.permutation(len(terms))[:LEFT_OUT].tolist()
    rests = [confidence.bound_sum(terms[:place] + terms[place + 1 :]) for place in left_out]
    return SuiteCheck(
        covered=whole.interval.low <= truth <= whole.interval.high,
        below_at_most=truth <= whole.at_most,
        above_at_least=truth >= whole.at_least,
        monotone=all(_is_within(rest, whole) for rest in rests),
        zeros=sum(not term.probability.value for term in terms),
        ratio=whole.interval.high / truth,
        scenarios=len(terms),
        renamed=_compare(
            whole, confidence.bound_sum([replace(each, name=f"{each.name}'") for each in terms])
        ),
    )


def _compare(one: confidence.RateBounds, other: confidence.RateBounds) -> float:
    """Return the largest relative difference of the bounds that are not 0."""
    return max(abs(second / first - 1.0) for first, second in _pair(one, other) if first)


def _pair(
    one: confidence.RateBounds, other: confidence.RateBounds
) -> tuple[tuple[float, float], ...]:
    return (
        (one.at_least, other.at_least),
        (one.at_most, other.at_most),
        (one.interval.low, other.interval.low),
        (one.interval.high, other.interval.high),
    )


def _is_within(rest: confidence.RateBounds, whole: confidence.RateBounds) -> bool:
    return all(one <= other * (1.0 + ROUNDING) for one, other in _pair(rest, whole))


def make_suite(generator: np.random.Generator) -> tuple[list[confidence.RiskTerm], float]:
    """Return the evidence on the scenarios of a made-up suite, and its true rate. [1/h]"""
    hours = draw_between(generator, HOURS)
    has_one_seed = bool(generator.integers(2))
    noise = generator.random(EPISODES[1])
    terms, truth = list[confidence.RiskTerm](), 0.0
    for place in range(int(draw_between(generator, (1.0, MOST_SCENARIOS + 1.0)))):
        rate, p = draw_between(generator, RATES), draw_between(generator, PROBABILITIES)
        truth += rate * p
        episodes = int(draw_between(generator, EPISODES))
        known: confidence.Confidence
        if generator.random() < 0.5:
            own = noise if has_one_seed else generator.random(episodes)
            known, name = count_failures(generator, own[:episodes] < p, p), "seed 1"
        else:
            known, name = estimate_by_runs(generator, p), f"seed {place + 2}"
        name = name if has_one_seed else f"seed {place + 2}"
        met = count_encounters(generator, rate, hours)
        terms.append(confidence.RiskTerm(f"scenario {place}", met, known, name, episodes))
    return terms, truth


def count_encounters(
    generator: np.random.Generator, rate: float, hours: float
) -> confidence.Confidence:
    """Return the evidence on a true rate: a Poisson number, or a value with its interval."""
    if generator.random() < 0.5:
        return confidence.EventRate(int(generator.poisson(rate * hours)), hours)
    width = draw_between(generator, WIDTHS)
    value = rate * exp(log(width) / Z * generator.standard_normal())
    return confidence.Stated(value, value / width, value * width)


def count_failures(
    generator: np.random.Generator, failed: NDArray[np.bool_], p: float
) -> confidence.Confidence:
    """Return what a campaign of Monte Carlo states: of a fixed number, or with a stop rule."""
    counts, rule = np.cumsum(failed), generator.random()
    if rule < 1.0 / 3.0:
        limit = int(generator.integers(FAILURES_TO_STOP[0], FAILURES_TO_STOP[1] + 1))
        if counts[-1] >= limit:
            stopped = StoppedTrials(limit, int(np.searchsorted(counts, limit)), 1, 0)
            ends = stopped.find_bounds(limit)
            return confidence.Stated(stopped.estimate(limit), ends.low, ends.high)
    elif rule < 2.0 / 3.0:
        return stop_by_width(counts, draw_between(generator, HALF_WIDTHS) * p)
    k = int(counts[-1])
    return confidence.FailureShare(k, 0, len(failed), k / len(failed))


def stop_by_width(counts: NDArray[np.int64], half_width: float) -> confidence.Stated:
    """Return the share of failures with its confidence sequence, once that is narrow enough."""
    trials = 0
    while trials < len(counts):
        trials = min(trials + max(trials // 10, 10), len(counts))
        k = int(counts[trials - 1])
        ends = confidence_sequence(k, trials)
        if ends.high - ends.low <= 2.0 * half_width:
            break
    return confidence.Stated(k / trials, ends.low, ends.high)


def estimate_by_runs(generator: np.random.Generator, p: float) -> confidence.RunEstimate:
    """Return the mean of independent runs without bias, with its error as found between them."""
    runs = int(generator.integers(RUNS[0], RUNS[1] + 1))
    spread = draw_between(generator, RUN_ERRORS)
    found = p * np.exp(spread * generator.standard_normal(runs) - spread**2 / 2.0)
    value = float(found.mean())
    cv = float(found.std(ddof=1)) / sqrt(runs) / value
    interval = log_normal(value, cv, float(runs))
    made = Estimate(by="runs", episodes=runs, probability=value, cv=cv, interval=interval)
    known = confidence.RunEstimate.of(made)
    assert known is not None
    return known


def draw_between(generator: np.random.Generator, ends: Sequence[float]) -> float:
    """Return a number whose logarithm is uniform between those of two ends."""
    return exp(generator.uniform(log(ends[0]), log(ends[1])))


TRIALS = ((("risk.",), find_cover),)
TARGETS = {
    "risk.cover": Target(low=0.93),
    "risk.cover.at_least": Target(low=0.93),
    "risk.cover.at_most": Target(low=0.93),
    "risk.monotone": Target(low=1.0),
}
