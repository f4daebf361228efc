"""Figures: how often the intervals that `eigenfail risk` states hold the true rate of failures.

A suite is made up: scenarios with a true rate of encounters and a true P(failure), a log of driving
with a Poisson number of encounters, and a campaign of each scenario: counts of Monte Carlo, or the
mean of a few independent runs with log-normal errors, as subset simulation states it. In half of
the suites all campaigns of Monte Carlo have one seed: their episodes of equal index fail together
as often as they can. `risk.cover` is the share of suites whose two-sided interval holds the truth,
`risk.monotone` that in which no scenario can be left out so that a bound becomes larger, and
`risk.zero_failures` the number of scenarios without a failure in all suites.
"""

from collections.abc import Iterator, Sequence
from math import exp, log, sqrt
from typing import NamedTuple

import numpy as np
from crew import Crew
from figures import Figure
from samples import COMMAND, count_share, median, share

from eigenfail.risk.confidence import (
    Confidence,
    EventRate,
    FailureShare,
    RateBounds,
    RiskTerm,
    RunEstimate,
    bound_sum,
)
from eigenfail.values import Estimate
from eigenfail_services.statistics.intervals import log_normal

SUITES = 200
MOST_SCENARIOS = 12
HOURS = (20.0, 5_000.0)
RATES = (1e-3, 10.0)
PROBABILITIES = (1e-6, 0.3)
EPISODES = (100, 100_000)
RUN_ERRORS = (0.05, 0.8)
RUNS = (2, 10)
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
        ratio: upper end of the interval ÷ the true rate.
    """

    covered: bool
    below_at_most: bool
    above_at_least: bool
    monotone: bool
    zeros: int
    ratio: float


def find_cover(crew: Crew, seed: int) -> Iterator[tuple[str, Figure]]:
    """How often intervals and bounds hold, and whether they are monotone."""
    found = crew.each(check_suite, range(seed, seed + SUITES))
    note = f"1 to {MOST_SCENARIOS} scenarios, with 2 to 10 runs or 100 to 100000 episodes each"
    yield "risk.cover", share([each.covered for each in found], note)
    yield "risk.cover.at_most", share([each.below_at_most for each in found], note)
    yield "risk.cover.at_least", share([each.above_at_least for each in found], note)
    yield "risk.monotone", count_share([each.monotone for each in found], note)
    yield "risk.high_over_truth", median([each.ratio for each in found], "ratio", note)
    zeros = float(sum(each.zeros for each in found))
    yield (
        "risk.zero_failures",
        Figure(value=zeros, unit="scenarios", n=SUITES, note=note, command=COMMAND),
    )


def check_suite(seed: int) -> SuiteCheck:
    """Return how a made-up suite does."""
    generator = np.random.default_rng([seed, 22])
    terms, truth = make_suite(generator)
    whole = bound_sum(terms)
    rests = [bound_sum(terms[:place] + terms[place + 1 :]) for place in range(len(terms))]
    return SuiteCheck(
        covered=whole.interval.low <= truth <= whole.interval.high,
        below_at_most=truth <= whole.at_most,
        above_at_least=truth >= whole.at_least,
        monotone=all(_is_within(rest, whole) for rest in rests),
        zeros=sum(not term.probability.value for term in terms),
        ratio=whole.interval.high / truth,
    )


def _is_within(rest: RateBounds, whole: RateBounds) -> bool:
    pairs = (
        (rest.at_least, whole.at_least),
        (rest.at_most, whole.at_most),
        (rest.interval.low, whole.interval.low),
        (rest.interval.high, whole.interval.high),
    )
    return all(one <= other * (1.0 + ROUNDING) for one, other in pairs)


def make_suite(generator: np.random.Generator) -> tuple[list[RiskTerm], float]:
    """Return what is known of the scenarios of a made-up suite, and its true rate. [1/h]"""
    hours = draw_between(generator, HOURS)
    has_one_seed = bool(generator.integers(2))
    noise = generator.random(EPISODES[1])
    terms, truth = list[RiskTerm](), 0.0
    for place in range(int(generator.integers(1, MOST_SCENARIOS + 1))):
        rate, p = draw_between(generator, RATES), draw_between(generator, PROBABILITIES)
        truth += rate * p
        episodes = int(draw_between(generator, EPISODES))
        known: Confidence
        if generator.random() < 0.5:
            own = noise if has_one_seed else generator.random(episodes)
            k = int(np.count_nonzero(own[:episodes] < p))
            known, name = FailureShare(k, 0, episodes, k / episodes), "seed 1"
        else:
            known, name = estimate_by_runs(generator, p), f"seed {place + 2}"
        name = name if has_one_seed else f"seed {place + 2}"
        counted = EventRate(int(generator.poisson(rate * hours)), hours)
        terms.append(RiskTerm(f"scenario {place}", counted, known, name, episodes))
    return terms, truth


def estimate_by_runs(generator: np.random.Generator, p: float) -> RunEstimate:
    """Return the mean of independent runs without bias, with its error as found between them."""
    runs = int(generator.integers(RUNS[0], RUNS[1] + 1))
    spread = draw_between(generator, RUN_ERRORS)
    found = p * np.exp(spread * generator.standard_normal(runs) - spread**2 / 2.0)
    value = float(found.mean())
    cv = float(found.std(ddof=1)) / sqrt(runs) / value
    interval = log_normal(value, cv, float(runs))
    made = Estimate(by="runs", episodes=runs, probability=value, cv=cv, interval=interval)
    known = RunEstimate.of(made)
    assert known is not None
    return known


def draw_between(generator: np.random.Generator, ends: Sequence[float]) -> float:
    """Return a number whose logarithm is uniform between those of two ends."""
    return exp(generator.uniform(log(ends[0]), log(ends[1])))
