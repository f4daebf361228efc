"""The paper's statements, held against numbers that make them true, false, or open."""

import msgspec
import pytest

from eigenfail.values.comparison import Comparison, Difference, Side
from eigenfail.values.estimates import Cost, Interval
from eigenfail_reproduction.judgements import is_greater
from eigenfail_reproduction.programme import PROGRAMMES
from eigenfail_reproduction.statements import NEEDED, judge_campaigns

CUT_IN, DRIVE = PROGRAMMES["cut_in"], PROGRAMMES["highway_drive"]

NOTHING = Side(
    campaigns=(1,),
    completed=0,
    failures=0,
    failure_rate=None,
    rates=(None,),
    log_probability_per_step=None,
    mean_severity=None,
    cost=Cost(0.0, 0.0, None, None, None),
)


def comparing(summaries):
    """B minus A, as sure as plus or minus 5 %."""

    def compare(a, b):
        value = summaries[b].failure_rate.value - summaries[a].failure_rate.value
        return Comparison(
            a=NOTHING,
            b=NOTHING,
            difference=Difference(value, Interval(value - 0.05, value + 0.05), 300, 300),
            pairs=None,
            unpaired_because="",
            effect=None,
            distinctions=(),
        )

    return compare


@pytest.fixture
def judged(summaries, safety):
    """What becomes of the statement with these words."""

    def judge(of, name=""):
        safeties = {name: safety(summaries[name]) for name in NEEDED if name in summaries}
        found = judge_campaigns(summaries, safeties, comparing(summaries), CUT_IN)
        return next(one for one in found if of in one.paper and name in one.figures)

    return judge


def test_planners_and_rare_failures_hold_as_in_the_paper(judged):
    assert judged("less often than IDM").holds is True
    assert judged("Monte Carlo finds no failure").holds is True
    assert "0 of 2,000" in judged("Monte Carlo finds no failure").figures


def test_planners_whose_intervals_overlap_are_open(judged, summaries, summary):
    for failures, expected in ((850, False), (750, None), (600, True)):
        summaries["monte_carlo rulebook"] = summary(1, "monte_carlo", failures, 2000)
        summaries["monte_carlo idm"] = summary(2, "monte_carlo", 725, 2000)
        assert judged("less often than IDM").holds is expected


def test_a_search_that_finds_nothing_refutes_for_its_settings(judged, summaries, summary):
    summaries["difs_paper evaluation"] = summary(9, "", 0)
    words = "Monte Carlo finds no failure"
    assert judged(words).holds is True
    assert judged(words, "difs_paper").holds is False


@pytest.mark.parametrize(
    ("small", "expected"),
    [
        ({"failures": 280, "per_step": -1.5, "severity": 150.0}, True),
        ({"failures": 280, "per_step": -2.5, "severity": 150.0}, False),
        ({"failures": 100, "per_step": -1.5, "severity": 150.0}, False),
        ({"failures": 155, "per_step": -1.5, "severity": 150.0}, None),
        ({"failures": 155, "per_step": -2.5, "severity": 150.0}, False),
    ],
)
def test_a_small_batch_must_be_better_in_all_three(judged, summaries, summary, small, expected):
    failures = small.pop("failures")
    summaries["sweep batch_size=16"] = summary(9, "", failures, **small)
    assert judged("small batch").holds is expected


def test_a_small_batch_is_compared_with_both_larger_ones(judged, summaries, summary):
    """Better than the largest alone decides nothing."""
    summaries["sweep batch_size=16"] = summary(9, "", 150, per_step=-1.5, severity=150.0)
    summaries["sweep batch_size=256"] = summary(9, "", 60)
    summaries["sweep base"] = summary(9, "", 280)
    assert judged("small batch").holds is None
    summaries["sweep base"] = summary(9, "", 60)
    assert judged("small batch").holds is True


def test_a_large_c_dist_is_compared_with_both_smaller_ones(judged, summaries, summary):
    summaries["sweep c_dist=5000"] = summary(9, "", 250, severity=150.0)
    assert judged("large c_dist").holds is True
    summaries["sweep base"] = summary(9, "", 290)
    assert judged("large c_dist").holds is None


def test_sums_in_another_order_leave_the_likelihood_open(judged, summaries, summary):
    likelier = summary(9, "", 30, per_step=-1.9)
    summaries["difs evaluation"] = msgspec.structs.replace(likelier, mean_log_probability=-170.0)
    assert judged("likelier failures than AST").holds is None


def test_each_statement_says_its_rule(summaries, safety):
    safeties = {name: safety(summaries[name]) for name in NEEDED if name in summaries}
    assert all(
        one.rule for one in judge_campaigns(summaries, safeties, comparing(summaries), CUT_IN)
    )


def test_a_small_alpha_trades_failures_for_likelihood(judged, summaries, summary):
    summaries["sweep alpha=500"] = summary(9, "", 60, per_step=-1.5)
    assert judged("small alpha").holds is True
    summaries["sweep alpha=500"] = summary(9, "", 280, per_step=-1.5)
    assert judged("small alpha").holds is False


def test_each_statement_that_does_not_hold_says_why(summaries, summary, safety):
    for name in summaries:
        summaries[name] = summary(9, "", 0)
    safeties = {name: safety(summaries[name]) for name in NEEDED if name in summaries}
    found = [*judge_campaigns(summaries, safeties, comparing(summaries), CUT_IN)]
    assert all(each.why for each in found if each.holds is False)


def test_difs_is_likelier_only_where_both_fail(judged, summaries, summary):
    summaries["difs evaluation"] = summary(9, "", 30, per_step=-1.9)
    assert judged("likelier failures than AST").holds is True
    summaries["difs evaluation"] = summary(9, "", 0)
    assert judged("likelier failures than AST").holds is None
    summaries["difs evaluation"] = summary(9, "", 9, per_step=-1.0)
    assert judged("likelier failures than AST").holds is None, "too few"


def test_a_policy_that_moves_badly_is_told(judged, summaries, summary):
    summaries["ast plus5"] = summary(9, "", 270, 300)
    summaries["ast minus5"] = summary(9, "", 270, 300)
    summaries["ast evaluation"] = summary(9, "", 290, 300)
    assert judged("other distances").holds is True
    summaries["ast minus5"] = summary(9, "", 60, 300)
    assert judged("other distances").holds is False
    summaries["ast minus5"] = summary(9, "", 150, 300)
    assert judged("other distances").holds is None
    assert judged("other distances", "ast_paper").holds is None


def test_a_difference_within_its_interval_is_none():
    near, far = [-2.0, -2.2] * 20, [-1.9, -2.1] * 20
    assert is_greater(near, far) is True
    assert is_greater(far, near) is False
    assert is_greater([-2.0, -2.8] * 5, [-1.9, -2.7] * 5) is None, "so wide, it may be chance"
    assert is_greater(near, near) is None
    assert is_greater(near, far[:9]) is None
    assert is_greater([1.0] * 10, [1.0] * 10) is None


@pytest.fixture
def judged_drive(summaries, summary, safety):
    """What becomes of the statement with these words on the drive."""
    for suffix in ("", "_paper"):
        for place in DRIVE.moved:
            summaries[f"ast{suffix} {place}"] = summary(200, "", 90, 100)

    def judge(of):
        safeties = {name: safety(summaries[name]) for name in NEEDED if name in summaries}
        found = judge_campaigns(summaries, safeties, comparing(summaries), DRIVE)
        return next(one for one in found if of in one.paper)

    return judge


def test_a_small_tau_and_a_large_buffer_are_judged_where_they_have_an_effect(
    judged_drive, summaries, summary
):
    assert judged_drive("small tau").holds is None, "the same"
    assert not judged_drive("small tau").asked, "a setting without an effect"
    summaries["sweep tau=0.001"] = summary(9, "", 150, per_step=-1.5)
    assert judged_drive("small tau").holds is True
    summaries["sweep tau=0.01"] = summary(9, "", 150, per_step=-1.0)
    assert judged_drive("small tau").holds is None, "the choices differ"
    summaries["sweep buffer_size=10000"] = summary(9, "", 150, per_step=-1.5)
    assert judged_drive("large buffer").holds is False
    summaries["sweep buffer_size=10000"] = summary(9, "", 9, per_step=-3.0)
    one = judged_drive("large buffer")
    assert (one.holds, one.asked) == (None, False), "too few"


def test_similar_scenarios_of_the_drive_are_those_of_its_programme(judged_drive, summaries):
    one = judged_drive("other distances")
    assert "ast farther: 90 of 100 failed; ast nearer: 90 of 100 failed" in one.figures
    assert one.subject == "ast"


def test_without_monte_carlo_and_sweep_their_statements_are_left_out(summaries, safety):
    kept = {
        name: one
        for name, one in summaries.items()
        if not name.startswith(("monte_carlo", "sweep"))
    }
    safeties = {name: safety(kept[name]) for name in NEEDED if name in kept}
    found = [*judge_campaigns(kept, safeties, comparing(kept), CUT_IN)]
    assert {one.paper for one in found} == {
        "DiFS finds likelier failures than AST.",
        "AST's policy fails the planner at other distances of the cut-in, too.",
    }


def test_what_too_few_failures_leave_open_was_not_asked(judged, summaries, summary):
    assert judged("likelier failures than AST").asked
    summaries["difs evaluation"] = summary(9, "", 9)
    assert not judged("likelier failures than AST").asked
    assert not judged("small tau").asked
    summaries["sweep batch_size=16"] = summary(9, "", 3)
    assert judged("small batch").why == "There are fewer than 10 failures of one of them."
