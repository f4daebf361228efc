"""Trials that end with their k-th event: bias and coverage, by summing over all ends."""

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.stats import beta, binom

from eigenfail_services.statistics.intervals import clopper_pearson
from eigenfail_services.statistics.stopped_trials import StoppedTrials

Ends = Iterator[tuple[StoppedTrials, int, float]]


def list_ends(p: float, limit: int, size: int, ahead: int, budget: int) -> Ends:
    """Yield every end of trials in rounds, with its events and its probability.

    Rounds are looked at as a campaign does: after each of them, while the budget is not spent by
    those that are open.
    """
    alive, early, cuts = np.ones(1), 0, [*range(size, budget, size), budget]
    for place, cut in enumerate(cuts):
        run = cuts[min(place + ahead, len(cuts) - 1)]
        if run == budget:
            yield from count_ends(StoppedTrials(limit, early, 0, budget - early), alive, p)
            return
        seen = add_trials(alive, cut - early, p)
        ended = np.where(np.arange(len(seen)) >= limit, seen, 0.0)
        yield from count_ends(StoppedTrials(limit, early, cut - early, run - cut), ended, p)
        alive, early = seen[:limit], cut


def add_trials(chances: np.ndarray, n: int, p: float) -> np.ndarray:
    return np.convolve(chances, binom.pmf(np.arange(n + 1), n, p))


def count_ends(end: StoppedTrials, chances: np.ndarray, p: float) -> Ends:
    rest = end.late if end.deciding else end.trials - end.early
    for events, chance in enumerate(add_trials(chances, rest, p).tolist()):
        if chance > 1e-15:
            yield end, events, chance


DESIGNS = [
    # limit, size of rounds, rounds that are open besides, budget
    (1, 1, 0, 200),
    (5, 1, 0, 100),
    (1, 10, 1, 200),
    (3, 7, 0, 100),
    (10, 50, 1, 420),
    (2, 100, 1, 1000),
]
PROBABILITIES = [0.3, 0.1, 0.01]


@pytest.mark.parametrize("design", DESIGNS)
@pytest.mark.parametrize("p", PROBABILITIES)
def test_the_estimate_has_no_bias_and_each_side_of_the_interval_holds(
    design: tuple[int, int, int, int], p: float
) -> None:
    mean = total = too_high = too_low = 0.0
    for end, events, chance in list_ends(p, *design):
        estimate = end.estimate(events)
        total, mean = total + chance, mean + chance * (estimate or 0.0)
        if chance < 1e-8:  # all of these together are below 1e-5
            continue
        found = end.find_bounds(events)
        too_high += chance * (found.low > p)
        too_low += chance * (found.high < p)
        assert estimate is None or found.low <= estimate <= found.high
    assert total == pytest.approx(1.0, abs=1e-9)
    assert mean == pytest.approx(p, rel=1e-9)
    assert max(too_high, too_low) <= 0.025
    assert too_high + too_low <= 0.05


@pytest.mark.parametrize(("k", "n"), [(2, 7), (10, 57), (30, 31), (5, 5)])
def test_rounds_of_one_trial_are_inverse_sampling(k: int, n: int) -> None:
    end = StoppedTrials(k, n - 1, 1, 0)
    assert end.estimate(k) == pytest.approx((k - 1) / (n - 1))
    found = end.find_bounds(k)
    assert found.low == pytest.approx(beta.ppf(0.025, k, n - k + 1))
    assert found.high == pytest.approx(beta.ppf(0.975, k, n - k) if n > k else 1.0)


def test_the_first_event_has_no_estimate_but_an_interval() -> None:
    end = StoppedTrials(1, 99, 1, 0)
    assert end.estimate(1) is None
    assert end.find_bounds(1).low == pytest.approx(1.0 - 0.975 ** (1 / 100))
    assert end.find_bounds(1).high == pytest.approx(1.0 - 0.025 ** (1 / 99))


def test_a_budget_that_ends_before_the_events_is_a_fixed_number() -> None:
    for events in range(4):
        end = StoppedTrials(4, 90, 0, 10)
        assert end.estimate(events) == events / 100
        assert end.find_bounds(events) == clopper_pearson(events, 100)


def test_a_first_look_at_everything_is_a_fixed_number_in_all_but_its_condition() -> None:
    """Where the first of two rounds almost surely has enough events, nothing was chosen."""
    end = StoppedTrials(1, 0, 100, 100)
    found, fixed = end.find_bounds(60), clopper_pearson(60, 200)
    assert end.estimate(60) == pytest.approx(0.3, rel=1e-9)
    assert (found.low, found.high) == pytest.approx((fixed.low, fixed.high), rel=1e-9)


def test_large_campaigns_take_no_time() -> None:
    end = StoppedTrials(10_000, 999_000, 1_000, 1_000)
    found = end.find_bounds(10_015)
    assert found.low < end.estimate(10_015) < found.high
    assert (found.low, found.high) == pytest.approx((0.00981, 0.0102), abs=2e-5)
