"""The course of a campaign: blocks, their length, and what they are called."""

import pytest
from made_campaigns import make_campaign
from msgspec.structs import replace

from eigenfail.errors import InvalidValue
from eigenfail.values.campaign import Campaign, Counts
from eigenfail.values.summary import BlockTotals
from eigenfail_services.analysis.campaign_figures import choose_block_length, make_course
from eigenfail_services.statistics.intervals import rate


@pytest.mark.parametrize(
    ("planned", "cancelled", "per"),
    [
        (1, 0, 1),
        (300, 0, 30),
        (301, 0, 31),
        (5_000, 0, 100),
        (5_001, 0, 101),
        (1_000_000, 0, 20_000),
        (1_000_000, 999_700, 30),
        (7, 7, 1),
    ],
)
def test_blocks_are_of_100_unless_they_would_be_too_few_or_too_many(
    planned, cancelled, per
) -> None:
    counts = Counts(planned, cancelled=cancelled)
    assert choose_block_length(counts) == per
    assert -(-(planned - cancelled) // per) <= 50


def test_a_length_that_is_given_is_kept_within_reason() -> None:
    assert choose_block_length(Counts(10_000), 10) == 10
    with pytest.raises(InvalidValue, match="at least 10"):
        choose_block_length(Counts(10_000), 9)
    with pytest.raises(InvalidValue, match="at least 1"):
        choose_block_length(Counts(10), 0)


def campaign(method: str) -> Campaign:
    return make_campaign(Counts(250, 153), method)


def test_blocks_by_hand() -> None:
    totals = [
        BlockTotals(0, 100, 0, 0.0, 0, 1.5, 4.0),
        BlockTotals(200, 53, 2, -300.0, 120, 0.0, None),
    ]
    found = make_course(campaign("monte_carlo"), 100, totals)
    assert (found.campaign, found.method, found.per) == (7, "monte_carlo", 100)
    first, second = found.blocks
    assert (first.first, first.last, first.failure_rate) == (0, 99, rate(0, 100))
    assert first.log_probability_per_step is None
    assert (first.smallest_robustness_m, first.median_robustness_m) == (1.5, 4.0)
    assert (second.first, second.last, second.failure_rate) == (200, 249, rate(2, 53))
    assert second.log_probability_per_step == -2.5
    assert second.median_robustness_m is None


def test_blocks_of_a_search_are_no_random_sample() -> None:
    totals = [BlockTotals(0, 100, 7, -300.0, 120, 0.0, None)]
    (drawn,), (chosen,) = (
        make_course(campaign(m), 100, totals).blocks for m in ("monte_carlo", "ast")
    )
    assert drawn.failure_rate == rate(7, 100)
    assert chosen.failure_rate == replace(rate(7, 100), sampled=False)


@pytest.mark.parametrize(
    ("method", "heading"),
    [
        ("ast", "Learning curve"),
        ("difs", "Learning curve"),
        ("cem", "Learning curve"),
        ("monte_carlo", "Failures over episodes"),
        ("replay", "Failures over episodes"),
    ],
)
def test_only_what_learns_has_a_learning_curve(method, heading) -> None:
    assert make_course(campaign(method), 100, []).heading == heading
