"""What became of failures: every case by hand, and what holds of any two campaigns."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from eigenfail.gate.reruns import JudgedBy, RerunSide, judge_rerun
from eigenfail.gate.verdicts import (
    CLOSING,
    STRICTLY_CLOSING,
    GateVerdict,
    RunOutcomes,
    describe_rates,
    judge_outcome,
    judge_pairs,
)
from eigenfail.intervals import difference, mcnemar, wilson
from eigenfail.values.comparison import Comparison as Found
from eigenfail.values.comparison import PairTotals, Side
from eigenfail.values.episode import Outcome
from eigenfail.values.estimates import Cost, Estimate, Interval, Rate

HIT, SAFE, FAILED = Outcome.COLLISION, Outcome.SAFE, Outcome.ERRORED
DOUBT = "unresolved"
"""A safe episode that ended when braking could no longer avoid a collision."""


@pytest.mark.parametrize(
    ("before", "now", "became"),
    [
        (SAFE, HIT, "new"),
        (HIT, HIT, "still failing"),
        (None, HIT, "unproven"),
        (HIT, SAFE, "fixed"),
        (SAFE, SAFE, "safe"),
        (None, SAFE, "safe"),
        (HIT, FAILED, "cannot be run"),
        (SAFE, None, "cannot be run"),
    ],
)
def test_every_pair_of_outcomes_has_one_verdict(before, now, became):
    assert judge_outcome(before, now) == became


def outcomes(row, found, campaign=2):
    """Of a list of outcomes in index order."""
    ended = [SAFE if outcome is DOUBT else outcome for outcome in found]
    rows = {index: row(index, outcome, campaign) for index, outcome in enumerate(ended)}
    return RunOutcomes(
        episodes=len(found),
        failures={index: each for index, each in rows.items() if each.outcome is HIT},
        errored={index: each for index, each in rows.items() if each.outcome is FAILED},
        unresolved={index: rows[index] for index, each in enumerate(found) if each is DOUBT},
    )


lists = st.lists(st.sampled_from([HIT, SAFE, FAILED]), max_size=8)


@pytest.fixture(scope="module")
def any_row():
    from types import SimpleNamespace

    return lambda index, outcome, campaign: SimpleNamespace(index=index, outcome=outcome)


@given(before=lists, now=lists)
def test_pairs_are_judged_as_a_table_of_both_would(any_row, before, now):
    found = judge_pairs(outcomes(any_row, before), outcomes(any_row, now))
    for index in range(max(len(before), len(now))):
        was = before[index] if index < len(before) else None
        was = None if was is FAILED else was
        is_now = now[index] if index < len(now) else None
        left_out = is_now is None or (is_now is FAILED and was is None)
        expected = GateVerdict.SAFE if left_out else judge_outcome(was, is_now)
        assert found.get(index, GateVerdict.SAFE) == expected


@given(found=lists)
def test_a_planner_against_itself_has_nothing_new(any_row, found):
    same = outcomes(any_row, found)
    assert set(judge_pairs(same, same).values()) <= {GateVerdict.STILL_FAILING}


@given(before=lists, now=lists)
def test_nothing_is_fixed_that_did_not_fail_and_new_that_did(any_row, before, now):
    was = outcomes(any_row, before)
    for index, became in judge_pairs(was, outcomes(any_row, now)).items():
        assert (became is GateVerdict.NEW) <= (was.of(index) is SAFE)
        assert (became in {GateVerdict.FIXED, GateVerdict.STILL_FAILING}) <= (was.of(index) is HIT)


@pytest.fixture
def compared(campaign, row):
    """Two campaigns as a service compares them, from the outcomes of both in index order."""

    def make(
        before, now, is_paired=True, by=JudgedBy.EPISODE, estimates=(None, None), *, closing=CLOSING
    ):
        sides = []
        for number, found in ((1, before), (2, now)):
            hits, broken = found.count(HIT), found.count(FAILED)
            told = campaign(
                number, len(found) - broken, hits, broken, estimate=estimates[number - 1]
            )
            sides.append(RerunSide(told, outcomes(row, found, number)))
        compared = comparison(before, now, is_paired)
        return judge_rerun(*sides, compared, "http://service", by, closing)

    return make


def side(failures, completed, is_sampled):
    """A side of a comparison, whose episodes are a random sample or those of a search."""
    rate = (
        Rate(failures / completed, failures, completed, None, sampled=is_sampled)
        if completed
        else None
    )
    return Side(
        campaigns=(1,),
        completed=completed,
        failures=failures,
        failure_rate=rate,
        rates=(rate.value if rate else None,),
        log_probability_per_step=None,
        mean_severity=None,
        cost=Cost(0.0, 0.0, None, None, None),
    )


def comparison(before, now, is_paired):
    """What the service makes of two lists of outcomes."""
    before, now = ([SAFE if each is DOUBT else each for each in side] for side in (before, now))
    both = list(zip(before, now, strict=False))
    totals = PairTotals(*(both.count(each) for each in ((HIT, HIT), (HIT, SAFE), (SAFE, HIT))))
    totals = replace(totals, neither=both.count((SAFE, SAFE)))
    ran = [len(found) - found.count(FAILED) for found in (before, now)]
    counted = [*zip((before.count(HIT), now.count(HIT)), ran, strict=True)]
    rates = [Rate(k / n, k, n, wilson(k, n)) for k, n in counted if n]
    sides = [side(*each, is_paired) for each in counted]
    return Found(
        a=sides[0],
        b=sides[1],
        difference=difference(*rates) if all(ran) else None,
        pairs=mcnemar(totals) if is_paired else None,
        unpaired_because="" if is_paired else "it learns.",
        effect=None,
        distinctions=(),
        warnings=("beware",),
    )


def test_where_noise_is_the_same_each_new_episode_counts(compared):
    found = compared([SAFE, HIT, HIT, SAFE], [HIT, HIT, SAFE, SAFE])
    assert found.verdict == "new"
    assert found.counts == {"new": 1, "still failing": 1, "fixed": 1}
    assert [(each.verdict, each.episode, each.was) for each in found.findings] == [
        ("new", "2/0", "1/0"),
        ("still failing", "2/1", "1/1"),
    ]
    assert found.findings[0].replay == "eigenfail episode replay 2/0"
    assert found.findings[0].link == "http://service/campaigns/2/episodes/0"
    pairs = "4 pairs of episodes under the same noise: 1 new, 1 still failing, 1 fixed"
    assert found.words == f"{pairs} (McNemar's exact test on 2: p = 1)."
    assert compared([SAFE], [SAFE]).words.endswith(": no failure.")
    assert found.warnings == ("beware",)


def test_by_rate_a_swap_of_failures_is_chance(compared):
    swapped = ([HIT] * 5 + [SAFE] * 15, [SAFE] * 4 + [HIT] * 3 + [SAFE] * 13)
    assert compared(*swapped).verdict == "new"
    by_rate = compared(*swapped, by=JudgedBy.RATE)
    assert by_rate.verdict == "still failing"
    assert by_rate.counts["new"] == 2
    one = [*[SAFE] * 19, HIT]
    assert compared(one, [HIT] * 6 + one[6:], by=JudgedBy.RATE).verdict == "new"
    assert compared(one, [HIT] * 5 + one[5:], by=JudgedBy.RATE).verdict == "still failing"
    assert compared([SAFE] * 20, one, by=JudgedBy.RATE).verdict == "new"
    assert compared([HIT] * 6 + [SAFE] * 14, [SAFE] * 20, by=JudgedBy.RATE).verdict == "fixed"
    assert compared([SAFE] * 3, [SAFE] * 3, by=JudgedBy.RATE).verdict == "safe"
    assert compared(one, [SAFE] * 20, by=JudgedBy.RATE).verdict == "safe"
    assert compared([HIT] * 5 + [SAFE] * 15, [SAFE] * 20, by=JudgedBy.RATE).verdict == "safe"
    assert compared([SAFE] * 3, [SAFE, SAFE, FAILED], by=JudgedBy.RATE).verdict == "cannot be run"


def test_a_search_is_new_beyond_the_threshold_alone(compared):
    # Newcombe's interval of 5/50 to 10/50 holds 0, that of 5/50 to 20/50 does not.
    def search(failures, is_now):
        found = [[HIT] * count + [SAFE] * (50 - count) for count in (failures, is_now)]
        return compared(*found, is_paired=False)

    assert search(5, 10).verdict == "still failing"
    assert search(5, 20).verdict == "new"
    assert search(20, 5).verdict == "fixed"
    assert search(5, 0).verdict == "fixed"
    assert search(0, 0).verdict == "safe"
    # The interval of 1/50 to 0/50 holds 0.
    assert search(1, 0).verdict == "safe"
    # A search chose its episodes: the interval is a threshold of the gate, and chance not judged.
    words = {search(*counts).words for counts in ((1, 0), (5, 10), (5, 20), (20, 5))}
    assert all("gate's threshold (difference" in each for each in words)
    assert not any("chance" in each for each in words)
    assert "1 of 50 did: none now, though the fall is within the gate's threshold" in (
        search(1, 0).words
    )
    assert "5 of 50 did: a rise beyond the gate's threshold" in search(5, 20).words
    assert search(0, 1).verdict == "new"
    assert "had no failures" in search(0, 1).words
    # The interval decides, but the episodes of a search are no sample that it could be told of.
    assert "(difference +30.0 %, without an interval: the method chose" in search(5, 20).words
    assert search(5, 20).unpaired_because == "it learns."
    assert search(5, 20).counts == {}
    assert {each.verdict for each in search(5, 20).findings} == {"unproven"}


def test_a_search_that_cannot_be_run_any_more_closes(compared):
    found = compared([SAFE] * 3, [FAILED] * 3, is_paired=False)
    assert found.verdict == "cannot be run"
    assert len(found.findings) == 3
    assert compared([FAILED, SAFE], [FAILED, SAFE], is_paired=False).verdict == "safe"


def test_estimates_are_compared_rather_than_the_rates_of_what_was_searched(compared):
    def estimate(low, high):
        return Estimate(by="subset simulation", episodes=9, interval=Interval(low, high))

    def judged(before, now):
        searched = ([HIT] * 5 + [SAFE] * 5, [HIT] * 5 + [SAFE] * 5)
        found = compared(*searched, is_paired=False, estimates=(before, now))
        return found.verdict, found.words.partition("did: ")[2].partition(" (")[0]

    its = "the 95 % interval of the failure probability lies"
    overlap = "the 95 % intervals of the failure probability overlap"
    assert judged(estimate(1e-4, 3e-4), estimate(2e-4, 9e-4)) == ("still failing", overlap)
    above, below = f"{its} above the baseline's", f"{its} below the baseline's"
    assert judged(estimate(1e-4, 3e-4), estimate(4e-4, 9e-4)) == ("new", above)
    assert judged(estimate(4e-4, 9e-4), estimate(1e-4, 3e-4)) == ("fixed", below)
    within = "a difference within the gate's threshold"
    assert judged(None, estimate(4e-4, 9e-4)) == ("still failing", within)


def test_lower_bounds_of_the_probability_decide_nothing(compared):
    def bound(probability):
        return Estimate(
            by="importance sampling", episodes=9, probability=probability, cv=0.01, bound="lower"
        )

    searched = ([HIT] * 5 + [SAFE] * 5, [HIT] * 5 + [SAFE] * 5)
    for before, now in ((1e-6, 1e-3), (1e-3, 1e-6)):
        told = compared(*searched, is_paired=False, estimates=(bound(before), bound(now)))
        assert told.verdict == "still failing"


@pytest.mark.parametrize("before", [[SAFE] * 19 + [FAILED], [HIT] * 3 + [SAFE] * 16 + [FAILED]])
def test_a_rerun_whose_every_episode_errored_closes_the_gate(compared, before):
    found = compared(before, [FAILED] * 20, is_paired=False)
    assert found.verdict == "cannot be run"


def test_of_random_samples_that_are_no_pairs_chance_is_judged(campaign):
    def words(verdict, was, is_now):
        found = comparison(
            *([HIT] * count + [SAFE] * (50 - count) for count in (was, is_now)), is_paired=True
        )
        told = [campaign(n, 50, count) for n, count in ((1, was), (2, is_now))]
        return describe_rates(verdict, *told, found)

    assert "5 of 50 did: more than chance explains (" in words(GateVerdict.NEW, 5, 20)
    assert "1 of 50 did: none now, though no fewer than chance" in words(GateVerdict.SAFE, 1, 0)


FEW = [HIT] * 10 + [SAFE] * 390
"""10 of 400 episodes fail."""


@pytest.mark.parametrize(
    ("before", "now", "hidden"),
    [
        ([SAFE, SAFE], [SAFE, SAFE], 0),
        ([SAFE, FAILED], [SAFE, FAILED], 1),
        ([HIT, SAFE], [DOUBT, SAFE], 0),
        ([SAFE, SAFE], [DOUBT, SAFE], 1),
        ([DOUBT, SAFE], [DOUBT, SAFE], 0),
        ([DOUBT, SAFE], [SAFE, DOUBT], 1),
        ([SAFE], [SAFE, FAILED], 0),
    ],
)
def test_an_episode_in_doubt_hides_what_would_close_the_gate(compared, before, now, hidden):
    assert compared(before, now).doubt.count("episode of campaign 2") == hidden
    strict = compared(before, now, closing=STRICTLY_CLOSING)
    assert bool(strict.doubt) == bool({DOUBT, FAILED} & {*now})


@pytest.mark.parametrize("is_paired", [True, False])
@pytest.mark.parametrize("doubt", [DOUBT, FAILED])
def test_by_rate_only_what_could_turn_the_verdict_is_in_doubt(compared, is_paired, doubt):
    def count_hidden(number):
        before, now = (
            [*FEW[: 400 - number], *[ended] * number]
            for ended in (FAILED if doubt is FAILED else SAFE, doubt)
        )
        found = compared(before, now, is_paired, JudgedBy.RATE)
        assert found.verdict == "still failing"
        return found.hidden_errored + found.hidden_unresolved

    assert [count_hidden(number) for number in (0, 1, 3)] == [0, 0, 0]
    assert count_hidden(40) == 40


@pytest.mark.parametrize("is_paired", [True, False])
def test_after_no_failure_one_episode_in_doubt_is_enough(compared, is_paired):
    found = compared([SAFE] * 400, [SAFE] * 399 + [DOUBT], is_paired, JudgedBy.RATE)
    assert (found.verdict, found.doubt) == ("safe", "1 unresolved episode of campaign 2")


def test_any_episode_in_doubt_may_raise_an_estimate(compared):
    estimate = Estimate(by="subset", episodes=9, interval=Interval(1e-4, 3e-4))
    sides = FEW, [*FEW[:399], DOUBT]
    found = compared(*sides, is_paired=False, estimates=(estimate, estimate))
    assert found.doubt == "1 unresolved episode of campaign 2"
    assert compared(*sides, is_paired=False).doubt == ""
