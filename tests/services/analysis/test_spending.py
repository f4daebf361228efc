"""Where the time and the money went: by hand, and parts that must sum to the whole."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_campaigns import make_campaign

from eigenfail.values.campaign import Campaign, Counts, Overhead
from eigenfail.values.summary import SpendingTotals, StoredProgress
from eigenfail_services.analysis.campaign_figures import (
    SLACK_S,
    KnownModes,
    _find_longest_gap,
    _list_active_s,
    has_unbilled_time,
    make_cost_curve,
    split_time,
)

NO_MODES = KnownModes(None, None, "")


def campaign(active_s: float = 100.0, **fields: Overhead) -> Campaign:
    """A campaign on two instances at 1.8 USD an hour, which began after 10 s."""
    price = {"price_usd_per_hour": 1.8, "instances": 2}
    given = {"started_ms": 10_000, "active_s": active_s}
    return make_campaign(Counts(9, 9, 3), "ast", spec=price, **given, **fields)


def test_a_hundred_seconds_by_hand() -> None:
    # 30 s learning and 10 s waiting leave 60 s with workers; a tenth of their work was lost.
    ran = campaign(overhead=Overhead(30.0, 10.0, 6.0))
    split = split_time(ran, SpendingTotals(completed_worker_s=90.0, errored_worker_s=4.0))
    assert split.lost_worker_s == 10.0
    assert split.simulation_s == pytest.approx(54.0)
    assert (split.learning_s, split.waiting_s) == (30.0, 10.0)
    assert split.lost_s == pytest.approx(6.0)
    assert (split.active_s, split.worker_s) == (100.0, 90.0)


seconds = st.floats(0.0, 1e6)


@given(seconds, st.builds(Overhead, seconds, seconds, seconds), seconds, seconds)
def test_the_parts_sum_to_the_whole(
    active_s: float, overhead: Overhead, kept_s: float, failed_s: float
) -> None:
    split = split_time(campaign(active_s, overhead=overhead), SpendingTotals(kept_s, failed_s))
    parts = (split.simulation_s, split.learning_s, split.waiting_s, split.lost_s)
    assert all(part >= -1e-9 * (1.0 + active_s) for part in parts)
    assert sum(parts) == pytest.approx(active_s, rel=1e-9, abs=1e-9)
    assert (split.lost_s > 0.0) <= (split.lost_worker_s > 0.0)


def progress(*seconds: float) -> tuple[StoredProgress, ...]:
    """One a completed episode, every second one a failure, so long after the start."""
    return tuple(
        StoredProgress(10_000 + round(1_000 * at_s), n, n // 2) for n, at_s in enumerate(seconds, 1)
    )


def test_a_curve_by_hand() -> None:
    # 2 instances at 1.8 USD an hour: 0.001 USD a second.
    known = KnownModes(3, (10_000 + 40_000,), "")
    found = list(
        make_cost_curve(campaign(), SpendingTotals(progress=progress(10.0, 40.0, 90.0)), known)
    )
    told = [(p.active_s, round(p.usd, 9), p.completed, p.failures, p.modes) for p in found]
    assert told == [
        (0.0, 0.0, 0, 0, 0),
        (10.0, 0.01, 1, 0, 0),
        (40.0, 0.04, 2, 1, 1),
        (90.0, 0.09, 3, 1, 1),
        (100.0, 0.1, 3, 1, 1),
    ]


def test_a_pause_costs_nothing() -> None:
    """100 s were billed, 1090 s passed: the gap of 1000 s was 10 s of work at most."""
    at_ms = [each.at_ms for each in progress(40.0, 80.0, 1080.0, 1090.0)]
    ran = campaign()
    assert has_unbilled_time(ran, at_ms)
    # 10 + 3 c = 100.
    assert _list_active_s(ran, at_ms) == pytest.approx([30.0, 60.0, 90.0, 100.0])


@pytest.mark.parametrize(
    ("last_s", "cut"), [(100.0, False), (100.0 + SLACK_S, False), (100.1 + SLACK_S, True)]
)
def test_time_beyond_that_billed_is_counted_from_the_start(last_s: float, cut: bool) -> None:
    at_ms = [each.at_ms for each in progress(0.001, last_s)]
    assert has_unbilled_time(campaign(), at_ms) is cut
    assert not has_unbilled_time(campaign(), [])


def test_the_longest_gap_by_hand() -> None:
    assert _find_longest_gap([1.0, 2.0, 10.0], 8.0) == 5.0
    assert _find_longest_gap([1.0, 2.0, 10.0], 2.4) == pytest.approx(0.8)
    assert _find_longest_gap([1.0, 2.0, 10.0], 13.0) == float("inf")
    assert _find_longest_gap([], 5.0) == float("inf")


@given(st.lists(st.floats(0.0, 1e4), max_size=40), st.floats(0.0, 1e5))
def test_curves_only_rise_and_end_at_the_bill(gaps: list[float], active_s: float) -> None:
    at_s = [sum(gaps[: n + 1]) for n in range(len(gaps))]
    ran = campaign(active_s)
    found = list(make_cost_curve(ran, SpendingTotals(progress=progress(*at_s)), NO_MODES))
    for before, after in pairwise(found):
        assert before.active_s <= after.active_s + 1e-9
        assert before.usd <= after.usd + 1e-9
        assert before.completed <= after.completed
        assert before.failures <= after.failures
    assert {point.modes for point in found} == {None}
    if gaps:
        assert found[-1].active_s == active_s


def test_before_the_first_episode_a_curve_is_its_start() -> None:
    (start,) = make_cost_curve(campaign(0.0), SpendingTotals(), NO_MODES)
    assert (start.usd, start.completed, start.failures, start.modes) == (0.0, 0, 0, None)
