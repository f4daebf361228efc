"""Bisection by known thresholds: what must be found, in how many steps, and what is told."""

from math import ceil, log2
from types import SimpleNamespace

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from msgspec import structs

from eigenfail.errors import InvalidValue
from eigenfail.margin import (
    MarginStep,
    NoFailure,
    RateAtMost,
    ScaleRange,
    ScaleVerdict,
    choose_criterion,
    describe_margin,
    find_fewest_failures,
    find_margin,
    read_step,
)
from eigenfail.settings import convert
from eigenfail.values import Campaign, CampaignSpec, CampaignState, Counts
from eigenfail_services.analysis.sampling_design import SamplingDesign
from eigenfail_services.statistics.intervals import clopper_pearson, rate
from eigenfail_services.statistics.stopped_trials import StoppedTrials

WIDE = ScaleRange(0.5, 3.0, 0.1)


NONE = NoFailure()


def step(scale, failures, criterion=NONE):
    found = rate(failures, 200)
    return MarginStep(
        scale=scale,
        campaign=1,
        episodes=200,
        failures=failures,
        verdict=criterion.judge(found),
        interval=found.interval,
    )


def planner(fails):
    """A planner that fails at scales where it is said to, and what was asked of it."""
    asked = []

    def measure(scale):
        asked.append(scale)
        return step(scale, int(fails(scale)))

    return measure, asked


ends = st.tuples(st.floats(0.01, 9.9), st.floats(0.02, 10.0)).filter(lambda pair: pair[0] < pair[1])


@given(ends=ends, tolerance=st.floats(0.001, 1.0), threshold=st.floats(0.0, 11.0))
def test_the_threshold_is_bracketed_within_tolerance_in_as_few_steps_as_halving_takes(
    ends, tolerance, threshold
):
    within = ScaleRange(*ends, tolerance)
    measure, asked = planner(lambda scale: scale >= threshold)
    found = find_margin(measure, within)
    assert found.contrary == ()
    assert [each.scale for each in found.steps] == sorted(asked)
    if found.largest_safe is None:
        assert threshold <= within.low
    elif found.smallest_unsafe is None:
        assert threshold > within.high
    else:
        safe, failing = found.largest_safe.scale, found.smallest_unsafe.scale
        assert safe < threshold <= failing
        assert failing - safe <= tolerance
    halvings = ceil(log2(max(1.0, (within.high - within.low) / tolerance)))
    assert len(asked) == len(set(asked)) <= 2 + halvings + 1


@given(failing=st.sets(st.integers(0, 64)), known=st.sets(st.integers(0, 64)))
def test_whatever_the_planner_does_the_cautious_reading_counts(failing, known):
    measure, _ = planner(lambda scale: round(32 * scale) in failing)
    within = ScaleRange(1 / 32, 2.0, 1 / 32)
    before = [measure(place / 32) for place in known]
    found = find_margin(measure, within, before)
    tried = {each.scale: not each.failures for each in found.steps}
    assert {1 / 32, 2.0} <= tried.keys()
    assert all(within.low <= scale <= within.high for scale in tried)
    bad = [scale for scale, safe in tried.items() if not safe]
    first = min(bad, default=None)
    assert (found.smallest_unsafe and found.smallest_unsafe.scale) == first
    good = [scale for scale, safe in tried.items() if safe]
    assert found.contrary == tuple(sorted(s for s in good if first is not None and s > first))
    below = [scale for scale in good if first is None or scale < first]
    assert (found.largest_safe and found.largest_safe.scale) == max(below, default=None)


@given(threshold=st.floats(0.5, 3.0), killed_after=st.integers(0, 7))
def test_a_search_that_was_killed_asks_only_for_the_rest(threshold, killed_after):
    measure, asked = planner(lambda scale: scale >= threshold)
    whole = find_margin(measure, WIDE)
    assume(killed_after <= len(asked))
    known, rest = asked[:killed_after], asked[killed_after:]
    again, asked_again = planner(lambda scale: scale >= threshold)
    resumed = find_margin(again, WIDE, [measure(scale) for scale in known])
    assert resumed == whole
    assert asked_again == rest


def test_the_steps_of_a_search_by_hand():
    measure, asked = planner(lambda scale: scale > 1.3)
    find_margin(measure, ScaleRange(0.5, 3.0, 0.2))
    assert asked == [0.5, 3.0, 1.75, 1.125, 1.4375, 1.28125]


@pytest.mark.parametrize(
    ("fails", "words"),
    [
        (
            lambda scale: scale > 1.32,
            (
                "No failure was found in 200 episodes at 1.281 × the specified noise; "
                "a failure was found at 1.359 × the specified noise."
            ),
        ),
        (lambda scale: scale > 1.0, "at 0.9688 × the specified noise; a failure was found at 1.0"),
        (lambda scale: True, "A failure was found at 0.5 × the specified noise, the low end"),
        (lambda scale: False, "in 200 episodes at 3 × the specified noise, the high end"),
    ],
)
def test_the_verdict_is_a_sentence(fails, words):
    found = find_margin(planner(fails)[0], WIDE)
    assert words in describe_margin(found, NONE, "monte_carlo")[0]


def test_what_no_failure_proves_is_said_with_its_bound():
    found = find_margin(planner(lambda scale: scale > 1.3)[0], WIDE)
    _, caveat, alone = describe_margin(found, NONE, "monte_carlo")
    assert alone.startswith("Each scale is judged by itself")
    assert "in 200 episodes at 1.281 × is not proof" in caveat
    assert "at most 1.49 % of the episodes under this noise fail." in caveat


@pytest.mark.parametrize("sampled", [True, False])
def test_only_episodes_under_p_bound_a_failure_rate(sampled):
    failure_rate = structs.replace(rate(0, 214), sampled=sampled)
    service = SimpleNamespace(
        campaigns=SimpleNamespace(summary=lambda _id: SimpleNamespace(failure_rate=failure_rate))
    )
    spec = CampaignSpec(name="n", method="ast", episodes=214)
    ended = Campaign(
        id=3, spec=spec, state=CampaignState.DONE, counts=Counts(214, 214, 0), created_ms=1
    )
    step = read_step(service, ended, NONE)
    assert step.interval == failure_rate.interval
    assert (step.interval is not None) == sampled
    margin = find_margin(lambda scale: structs.replace(step, scale=scale), WIDE)
    _, caveat, _ = describe_margin(margin, NONE, "ast")
    words = "'ast' chooses its noise, so that its episodes bound no failure rate."
    assert (words in caveat) is not sampled


def test_a_failure_below_a_safe_scale_is_told():
    found = find_margin(planner(lambda scale: scale < 1.0)[0], WIDE)
    assert found.largest_safe is None
    verdict, contradiction = describe_margin(found, NONE, "monte_carlo")
    assert "failure was found at 0.5 ×" in verdict
    assert "Not monotone: 3 × passed, above 0.5 ×, which did not." in contradiction


def test_an_earlier_failure_at_a_smaller_scale_draws_the_search_down():
    measure, asked = planner(lambda scale: scale > 2.0 or 0.9 < scale < 1.1)
    found = find_margin(measure, WIDE, [step(1.0, 3), step(9.0, 1), step(1.8, 0)])
    assert found.smallest_unsafe.scale <= 1.0
    assert found.contrary == (1.8,)
    assert max(asked) == 3.0
    assert all(scale < 1.0 for scale in asked[2:])


@pytest.mark.parametrize(
    ("low", "high", "tolerance"),
    [
        *((2.0, 2.0, 0.1), (3.0, 0.5, 0.1), (0.0, 1.0, 0.1), (1.0, 10.1, 0.1)),
        *((1.0, 2.0, 0.0), (float("nan"), 2.0, 0.1), (1.0, float("nan"), 0.1)),
        *((1.0, 2.0, float("nan")), (1.0, float("inf"), 0.1)),
    ],
)
def test_an_empty_range_is_refused(low, high, tolerance):
    with pytest.raises(InvalidValue):
        convert({"low": low, "high": high, "tolerance": tolerance}, ScaleRange, "search")


TARGET = RateAtMost(0.05, find_fewest_failures(0.05, 200))


@given(st.floats(1e-6, 0.5), st.integers(1, 5_000))
def test_the_fewest_failures_that_decide_are_where_the_exact_interval_leaves_the_target(
    target, episodes
):
    fewest = find_fewest_failures(target, episodes)
    if fewest is None:
        assert clopper_pearson(episodes, episodes).low <= target * (1.0 + 1e-9)
        return
    assert clopper_pearson(fewest, episodes).low > target * (1.0 - 1e-9)
    assert clopper_pearson(fewest - 1, episodes).low <= target * (1.0 + 1e-9)


@pytest.mark.parametrize(
    ("failures", "episodes", "verdict"),
    [
        (0, 59, ScaleVerdict.PASSED),  # 0.95^59 < 5 %
        (0, 58, ScaleVerdict.UNDECIDED),
        (4, 200, ScaleVerdict.UNDECIDED),  # [0.5, 5.04] %
        (3, 200, ScaleVerdict.PASSED),  # [0.3, 4.3] %
        (17, 200, ScaleVerdict.FAILING),  # [5.03, 13.3] %
        (16, 200, ScaleVerdict.UNDECIDED),  # [4.6, 12.7] %
        (17, 120, ScaleVerdict.FAILING),
    ],
)
def test_a_target_needs_an_interval_on_one_side_of_it(failures, episodes, verdict):
    # Rounds of 10, one of them open besides: at 200 episodes the budget ended the step.
    late = (0, 20) if episodes == 200 else (10, 10)
    ends = StoppedTrials(17, episodes - sum(late), *late)
    design = SamplingDesign(("monte_carlo",), judges_failures=True, ends=ends)
    assert TARGET.judge(design.make_rate(failures, episodes)) is verdict


def test_as_many_failures_as_end_a_step_decide_it():
    assert TARGET.failures == 17


@pytest.mark.parametrize(
    ("failures", "words"),
    [
        (
            lambda scale: 20 * (scale > 1.32),
            (
                "With 95 % confidence at most 5 % of the episodes fail at 1.281 × the specified "
                "noise (0 of 200 episodes failed); with 95 % confidence more than 5 % of the "
                "episodes fail at 1.359 × the specified noise (20 of 200 episodes failed)."
            ),
        ),
        (
            lambda scale: 8 * (scale > 1.32),
            (
                "it is undecided whether at most 5 % of the episodes fail at 1.359 × the specified "
                "noise (8 of 200 episodes failed). More episodes may decide it."
            ),
        ),
        (lambda _scale: 8, "no margin can be given. Give more episodes, or search lower."),
        (lambda _scale: 30, "the low end of the search: no margin can be given. Search lower."),
        (lambda _scale: 2, "(2 of 200 episodes failed), the high end of the search"),
    ],
)
def test_the_verdict_names_the_target_and_the_confidence(failures, words):
    found = find_margin(lambda scale: step(scale, failures(scale), TARGET), WIDE)
    assert words in describe_margin(found, TARGET, "monte_carlo")[0]


def test_what_is_undecided_is_not_safe():
    found = find_margin(lambda scale: step(scale, 8 * (scale > 1.3), TARGET), WIDE)
    assert found.largest_safe.scale <= 1.3 < found.smallest_unsafe.scale
    assert found.smallest_unsafe.verdict is ScaleVerdict.UNDECIDED


def monte_carlo(episodes, method="monte_carlo"):
    return CampaignSpec(name="n", method=method, episodes=episodes)


def test_without_a_target_one_failure_decides():
    assert choose_criterion(None, monte_carlo(7, "ast")) == NoFailure()
    assert NONE.failures == 1


def test_a_target_that_the_budget_cannot_show_is_refused():
    assert choose_criterion(0.01, monte_carlo(299)).target == 0.01
    with pytest.raises(InvalidValue, match=r"298 cannot show .* at most 0.01.*299 or more"):
        choose_criterion(0.01, monte_carlo(298))


def test_a_target_is_of_episodes_under_p():
    with pytest.raises(InvalidValue, match=r"'ast' chooses its noise.*Use monte_carlo"):
        choose_criterion(0.01, monte_carlo(1000, "ast"))
    with pytest.raises(InvalidValue, match="bound no failure rate"):
        TARGET.judge(structs.replace(rate(0, 200), sampled=False))
