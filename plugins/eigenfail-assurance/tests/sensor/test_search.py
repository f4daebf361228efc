"""Searches on functions whose limits are known: limits, their confidence, and contradictions."""

from itertools import pairwise
from math import ceil, log2
from statistics import NormalDist

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail.errors import InvalidValue
from eigenfail.intervals import find_lower_bound, find_upper_bound
from eigenfail.settings import convert
from eigenfail.values.estimates import Interval
from eigenfail_assurance.sensor.anchors import judge_bounds
from eigenfail_assurance.sensor.search import (
    Anchor,
    AnchorVerdict,
    MultipleRange,
    RequirementQuestion,
    find_limits,
)

MET, NOT_MET = AnchorVerdict.MET, AnchorVerdict.NOT_MET
UNDECIDED, UNKNOWN = AnchorVerdict.UNDECIDED, AnchorVerdict.UNKNOWN
BOUNDS = {
    MET: Interval(0.0, 0.01),
    NOT_MET: Interval(0.02, 0.5),
    UNDECIDED: Interval(0.0, 0.5),
    UNKNOWN: Interval(0.0, 1.0),
}


def make_anchor(multiples, verdict, bounds=None, failures=0):
    return Anchor(
        multiples=dict(multiples),
        campaign=1,
        episodes=100,
        failures=failures,
        probability=None,
        bounds=bounds or BOUNDS[verdict],
        verdict=verdict,
    )


def ask(**given):
    return RequirementQuestion(**{"target": 0.01, "channels": ("a",), **given})


def search(question, judge):
    """The answer about a planner that is judged by multiples, and what was tried, in order."""
    tried = []

    def measure(multiples, error):
        tried.append((dict(multiples), error))
        return make_anchor(multiples, judge(multiples))

    return find_limits(question, measure), tried


ranges = st.tuples(st.floats(0.01, 5.0), st.floats(1.02, 50.0), st.floats(0.01, 1.0)).map(
    lambda given: MultipleRange(given[0], given[0] * given[1], given[2])
)


@given(within=ranges, limit=st.floats(0.001, 300.0))
def test_the_limit_lies_between_neighbours_on_the_grid(within, limit):
    question = ask(within=within)
    answer, tried = search(question, lambda at: MET if at["a"] <= limit else NOT_MET)
    (found,) = answer.limits
    grid = within.make_grid()
    below, above = [x for x in grid if x <= limit], [x for x in grid if x > limit]
    assert found.largest == max(below, default=None)
    assert found.not_met_from == (min(above, default=None) if below else grid[0])
    assert found.undecided == ()
    assert found.at_high_end == (not above)
    assert len(tried) <= question.tests == 2 + ceil(log2(len(grid) - 1))


@given(within=ranges)
def test_neighbours_on_the_grid_differ_by_no_more_than_the_tolerance(within):
    grid = within.make_grid()
    assert grid[0] == pytest.approx(within.low, rel=1e-3)
    assert grid[-1] == pytest.approx(within.high, rel=1e-3)
    for one, other in pairwise(grid):
        assert one < other <= one * (1.0 + within.tolerance) * 1.002


def test_the_path_of_a_search_by_hand():
    question = ask(within=MultipleRange(1.0, 16.0, 1.0))
    answer, tried = search(question, lambda at: MET if at["a"] <= 5.0 else NOT_MET)
    assert [at["a"] for at, _ in tried] == [1.0, 16.0, 4.0, 8.0]
    assert {error for _, error in tried} == {question.test_error}
    assert question.test_error == pytest.approx(0.05 / 4)
    assert answer.limits[0].tests == (1.0, 16.0, 4.0, 8.0)


def test_what_is_undecided_leads_down_and_is_told():
    def judge(at):
        return MET if at["a"] < 3.0 else UNDECIDED if at["a"] < 10.0 else NOT_MET

    answer, _ = search(ask(within=MultipleRange(1.0, 64.0, 1.0)), judge)
    (limit,) = answer.limits
    assert (limit.largest, limit.undecided, limit.not_met_from) == (2.0, (4.0, 8.0), 16.0)


def test_what_is_met_beyond_an_undecided_error_does_not_count():
    verdicts = {1.0: MET, 2.0: MET, 4.0: UNDECIDED, 8.0: MET, 16.0: NOT_MET, 32.0: NOT_MET}
    answer, tried = search(ask(within=MultipleRange(1.0, 32.0, 1.0)), lambda at: verdicts[at["a"]])
    assert [at["a"] for at, _ in tried] == [1.0, 32.0, 4.0, 2.0, 8.0, 16.0]
    assert answer.limits[0].largest == 2.0
    assert answer.limits[0].not_met_from == 16.0


def test_an_undecided_low_end_ends_the_search():
    answer, tried = search(ask(), lambda at: UNDECIDED)
    assert len(tried) == 1
    assert answer.limits[0].largest is None
    assert answer.limits[0].undecided == (0.5,)


def test_where_failures_are_too_rare_for_a_number_larger_errors_are_tried():
    def measure(multiples, error):
        at = multiples["a"]
        verdict = UNKNOWN if at < 3.0 else MET if at < 5.0 else NOT_MET
        return make_anchor(multiples, verdict, failures=10)

    answer = find_limits(ask(within=MultipleRange(1.0, 16.0, 1.0)), measure)
    assert answer.limits[0].largest == 4.0


def test_without_a_number_and_with_many_failures_smaller_errors_are_tried():
    def measure(multiples, error):
        verdict = UNKNOWN if multiples["a"] > 3.0 else MET
        return make_anchor(multiples, verdict, failures=11)

    answer = find_limits(ask(within=MultipleRange(1.0, 16.0, 1.0)), measure)
    assert answer.limits[0].largest == 2.0
    assert answer.limits[0].not_met_from is None


def test_where_bounds_fall_as_errors_grow_the_smaller_error_counts():
    falling = {1.0: Interval(0.005, 0.009), 4.0: Interval(0.0, 0.001), 16.0: Interval(0.02, 1.0)}

    def measure(multiples, error):
        bounds = falling.get(multiples["a"], Interval(0.02, 1.0))
        return make_anchor(multiples, judge_bounds(bounds, 0.01), bounds)

    answer = find_limits(ask(within=MultipleRange(1.0, 16.0, 1.0)), measure)
    (pair,) = answer.contradictions
    assert (pair.smaller.multiples, pair.larger.multiples) == ({"a": 1.0}, {"a": 4.0})
    assert answer.limits[0].largest == 1.0


def test_errors_that_miss_the_target_in_one_search_count_in_all():
    within = MultipleRange(0.5, 2.0, 1.0)
    answer, _ = search(
        ask(channels=("a", "b"), within=within, points=3),
        lambda at: NOT_MET if at == {"a": 1.0, "b": 0.5} else MET,
    )
    # All other limits of one channel are those beside 1 × of the other one, which is more.
    assert {limit.channel: limit.largest for limit in answer.limits} == {"a": 0.5, "b": None}
    assert [limit.largest for limit in answer.frontier] == [2.0, None, None]


def test_the_frontier_has_fixed_multiples_of_the_first_channel_and_shares_the_error():
    question = ask(channels=("a", "b"), within=MultipleRange(0.5, 2.0, 0.1), points=3)
    answer, tried = search(
        question, lambda at: MET if at.get("a", 1.0) * at.get("b", 1.0) <= 1.0 else NOT_MET
    )
    assert [limit.beside for limit in answer.frontier] == [{"a": 0.5}, {"a": 1.0}, {"a": 2.0}]
    assert [limit.largest for limit in answer.frontier] == pytest.approx([2.0, 1.0, 0.5], rel=0.1)
    jointly = [error for at, error in tried if len(at) == 2]
    assert set(jointly) == {question.test_error / 3}
    assert len(jointly) <= 3 * question.tests


@pytest.mark.parametrize("channels", [("a",), ("a", "b", "c")])
def test_a_frontier_is_of_two_channels(channels):
    answer, _ = search(ask(channels=channels), lambda at: MET)
    assert answer.frontier == ()
    assert len(answer.limits) == len(channels)


@pytest.mark.parametrize(
    ("field", "given"),
    [
        ("target", {"target": 0.0}),
        ("target", {"target": 1.0}),
        ("target", {"target": float("nan")}),
        ("confidence", {"target": 0.1, "confidence": 1.0}),
        ("points", {"target": 0.1, "points": 1}),
        ("points", {"target": 0.1, "points": -1}),
        ("low", {"target": 0.1, "within": {"low": 2.0, "high": 1.0}}),
        ("within.tolerance", {"target": 0.1, "within": {"tolerance": 0.0}}),
        ("within.high", {"target": 0.1, "within": {"high": float("inf")}}),
    ],
)
def test_a_question_outside_its_bounds_is_refused_by_field(field, given):
    with pytest.raises(InvalidValue) as refused:
        convert(given, RequirementQuestion)
    assert refused.value.field == field


def test_the_limit_is_not_beyond_the_true_one_with_the_confidence():
    # P = Phi(-3 / multiple): 1e-2 is reached at 1.2896.
    normal, target, episodes = NormalDist(), 1e-2, 2_000
    truth = -3.0 / normal.inv_cdf(target)
    beyond = 0
    for seed in range(200):
        draws = np.random.default_rng(seed).standard_normal(episodes)

        def measure(multiples, error, draws=draws):
            k = int((multiples["a"] * draws >= 3.0).sum())
            bounds = Interval(
                find_lower_bound(k, episodes, error), find_upper_bound(k, episodes, error)
            )
            return make_anchor(multiples, judge_bounds(bounds, target), bounds, k)

        (limit,) = find_limits(ask(target=target), measure).limits
        assert limit.largest is not None
        assert limit.largest > 0.75 * truth  # the confidence is not bought with an empty answer
        beyond += limit.largest > truth
    assert beyond <= 10  # 5 %, of which the division of the error leaves about a seventh
