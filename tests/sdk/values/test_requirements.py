"""Requirements: their robustness in cases that are worked by hand, and what is refused."""

from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np
import pytest

from eigenfail.errors import InvalidValue, SimulatorError, UnknownName
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.measures import Measures
from eigenfail.values.requirements import (
    COLLISION_ALONE,
    LARGEST,
    AnyRequirement,
    EpisodeJudge,
    Formula,
    KeptLane,
    MeasureLimit,
    NoCollision,
    PreventableCollision,
    SafeDistance,
    TimeHeadway,
    UncausedBraking,
    check_requirements,
)
from eigenfail.values.signals import (
    NEVER_S,
    NOBODY_M,
    SIGNALS,
    DrivenCourse,
    ExpectedCourse,
    list_signals,
)

EXPECTED = ExpectedCourse(tuple(SIGNALS), 0.5, 10.0)


NOTHING_NEAR = Measures(4.0)


def drive(measures: Measures = NOTHING_NEAR, **signals: list[float]) -> DrivenCourse:
    """Return a course with steps of 0.5 s."""
    return DrivenCourse(0.5, {name: np.array(each) for name, each in signals.items()}, measures)


def test_no_collision_has_the_distance_of_footprints() -> None:
    assert NoCollision().find_robustness(drive(Measures(3.25))) == 3.25


def test_a_preventable_collision_has_the_distance_to_vehicles_that_count() -> None:
    course = drive(preventable_distance_m=[9.0, 2.5, 7.0])
    assert PreventableCollision().find_robustness(course) == 2.5


def test_the_rss_distance_is_that_of_its_definition() -> None:
    # 20 · 0.5 + 2 · 0.25 / 2 + 21² / (2 · 4.5) - 15² / (2 · 7.5) = 10 + 0.25 + 49 - 15 = 44.25.
    rss = SafeDistance(response_s=0.5, accelerate_mps2=2.0, brake_mps2=4.5, brake_ahead_mps2=7.5)
    course = drive(gap_m=[50.0, 45.0], speed_mps=[20.0, 20.0], leader_speed_mps=[15.0, 15.0])
    assert rss.find_robustness(course) == pytest.approx(0.75)


def test_the_rss_distance_is_never_below_zero() -> None:
    rss = SafeDistance()
    course = drive(gap_m=[3.0], speed_mps=[0.0], leader_speed_mps=[30.0])
    assert rss.find_robustness(course) == 3.0


def test_time_headway_has_the_smallest_one_minus_its_limit() -> None:
    course = drive(headway_s=[NEVER_S, 1.5, 0.75])
    assert TimeHeadway(at_least_s=0.5).find_robustness(course) == 0.25


@pytest.mark.parametrize(
    ("acceleration", "ttc", "headway", "robustness"),
    [
        ([0.0, -4.0, 0.0], [NEVER_S] * 3, [NEVER_S] * 3, -1.0),
        ([0.0, -2.0, 1.0], [NEVER_S] * 3, [NEVER_S] * 3, 1.0),
        ([1.0, 2.0], [NEVER_S] * 2, [NEVER_S] * 2, 3.0),
        # A vehicle on the way to a collision, or close ahead, is a cause,
        ([0.0, -4.0, 0.0], [5.0] * 3, [NEVER_S] * 3, 3.0),
        ([0.0, -4.0, 0.0], [NEVER_S] * 3, [1.0] * 3, 3.0),
        ([0.0, -4.0, 0.0], [6.0] * 3, [1.5] * 3, -1.0),
        # and for a second after it is gone; the planner decided on the state before the step.
        ([0.0, 0.0, 0.0, -4.0], [5.0, NEVER_S, NEVER_S, NEVER_S], [NEVER_S] * 4, 3.0),
        ([0.0, 0.0, 0.0, 0.0, -4.0], [5.0, *[NEVER_S] * 4], [NEVER_S] * 5, -1.0),
    ],
)
def test_hard_braking_needs_a_cause(
    acceleration: list[float], ttc: list[float], headway: list[float], robustness: float
) -> None:
    course = drive(acceleration_mps2=acceleration, ttc_ahead_s=ttc, headway_s=headway)
    assert UncausedBraking().find_robustness(course) == robustness


def test_lane_keeping_allows_what_it_says() -> None:
    course = drive(lane_margin_m=[0.5, -0.25])
    assert KeptLane().find_robustness(course) == -0.25
    assert KeptLane(beyond_m=0.5).find_robustness(course) == 0.25


@pytest.mark.parametrize(
    ("limit", "measures", "robustness"),
    [
        (MeasureLimit(measure="min_ttc_s", at_least=1.5), Measures(1.0, min_ttc_s=2.0), 0.5),
        (MeasureLimit(measure="min_ttc_s", at_least=1.5), Measures(1.0), NEVER_S - 1.5),
        (MeasureLimit(measure="hard_brakings", at_most=2), Measures(1.0, hard_brakings=3), -0.5),
        (MeasureLimit(measure="hard_brakings", at_most=0), Measures(1.0, hard_brakings=0), 0.5),
        (
            MeasureLimit(measure="max_jerk_mps3", at_least=1.0, at_most=9.0),
            Measures(1.0, max_jerk_mps3=8.0),
            1.0,
        ),
    ],
)
def test_a_measure_has_the_distance_from_the_nearer_limit(
    limit: MeasureLimit, measures: Measures, robustness: float
) -> None:
    assert limit.find_robustness(drive(measures)) == robustness


def test_a_measure_that_is_not_reported_cannot_be_judged() -> None:
    limit = MeasureLimit(measure="max_jerk_mps3", at_most=9.0)
    with pytest.raises(SimulatorError, match="does not report"):
        limit.find_robustness(drive(Measures(1.0)))


def test_a_formula_is_not_judged_on_one_number_that_is_not_finite() -> None:
    with pytest.raises(SimulatorError, match="gap_m is not finite"):
        Formula(formula="always (gap_m > 0)").find_robustness(drive(gap_m=[9.0, np.inf]))


def test_a_formula_is_judged_over_the_whole_course() -> None:
    formula = Formula(formula="always((gap_m < 5) implies (eventually[0:1] (gap_m >= 5)))")
    assert formula.find_robustness(drive(gap_m=[9.0, 4.0, 4.5, 6.0, 9.0])) == 1.0
    assert formula.find_robustness(drive(gap_m=[9.0, 4.0, 4.0, 4.0, 9.0])) == -1.0


def test_the_smallest_in_terms_of_scales_is_what_a_search_follows() -> None:
    requirements = (TimeHeadway(at_least_s=0.5), NoCollision())
    judged = EpisodeJudge(requirements).judge(drive(Measures(4.0), headway_s=[0.75]))
    assert judged.values == (0.25, 4.0)
    assert judged.smallest == pytest.approx(2.5)  # 0.25 s at 0.1 s a metre
    assert judged.violated is None


def test_the_first_in_their_order_is_the_one_that_is_violated() -> None:
    requirements = (NoCollision(), TimeHeadway(), KeptLane())
    judged = EpisodeJudge(requirements).judge(
        drive(Measures(4.0), headway_s=[0.1], lane_margin_m=[-9.0])
    )
    assert (judged.smallest, judged.violated) == (0.0, 1)


@pytest.mark.parametrize(
    ("drac", "followed"), [(5.0, 3.0), (7.0, 1.0), (9.0, 1.0 / 3.0), (1e9, 1.0 / (1.0 + LARGEST))]
)
def test_with_an_importance_safe_episodes_have_its_order(drac: float, followed: float) -> None:
    importance = MeasureLimit(measure="max_drac_mps2", at_most=7.0)
    judge = EpisodeJudge((NoCollision(),), importance)
    judged = judge.judge(drive(Measures(4.0, max_drac_mps2=drac)))
    assert (judged.smallest, judged.values) == (pytest.approx(followed), (4.0,))
    assert judge.judge(drive(Measures(0.0, max_drac_mps2=1.0))).smallest == 0.0


def test_what_is_followed_stays_finite() -> None:
    tiny = NoCollision(scale=1e-308)
    assert EpisodeJudge((tiny,)).judge(drive(Measures(100.0))).smallest == LARGEST


def test_robustness_stays_finite() -> None:
    far = Formula(formula="gap_m * 1000000 > 0")
    judged = EpisodeJudge((far,)).judge(drive(gap_m=[NOBODY_M]))
    assert judged.values == (LARGEST,)


@pytest.mark.parametrize(
    ("requirements", "field", "words"),
    [
        ((TimeHeadway(), TimeHeadway()), "requirements[1].name", "earlier"),
        ((MeasureLimit(measure="min_ttc_s"),), "requirements[0]", "no limit"),
        (
            (MeasureLimit(measure="severity", at_least=2.0, at_most=1.0),),
            "requirements[0]",
            "at_least is 2",
        ),
        (
            (MeasureLimit(measure="severity", at_most=0.0),),
            "requirements[0]",
            "never below 0",
        ),
        (
            (MeasureLimit(measure="hard_brakings", at_most=0.9),),
            "requirements[0]",
            "whole numbers",
        ),
        ((UncausedBraking(memory_s=0.7),), "requirements[0].memory_s", "whole number of steps"),
        ((Formula(formula="always(gap_m)"),), "requirements[0].formula", "comparison"),
    ],
)
def test_what_cannot_be_judged_is_refused_by_field(
    requirements: tuple[AnyRequirement, ...], field: str, words: str
) -> None:
    with pytest.raises(InvalidValue, match=words) as refused:
        check_requirements(requirements, EXPECTED)
    assert refused.value.field == field


@pytest.mark.parametrize(
    ("requirement", "near"),
    [
        (MeasureLimit(measure="min_ttc", at_least=1.0), "min_ttc_s"),
        (Formula(formula="always(headway > 1)"), "headway_s"),
    ],
)
def test_an_unknown_name_comes_with_the_near_one(requirement: AnyRequirement, near: str) -> None:
    with pytest.raises(UnknownName, match=f"Did you mean '{near}'"):
        check_requirements((requirement,), EXPECTED)


def test_a_signal_of_the_lane_needs_a_simulator_that_tells_it() -> None:
    told = list_signals(("longitudinal",), tells_lane=False)
    assert "error.longitudinal" in told
    with pytest.raises(InvalidValue, match="lane_margin_m"):
        check_requirements((KeptLane(),), EXPECTED._replace(signals=told))


def read(*requirements: Mapping[str, Any]) -> CampaignSpec:
    """Return a campaign with requirements as JSON has them."""
    plain = {"name": "c", "method": "monte_carlo", "episodes": 1, "requirements": requirements}
    return msgspec.convert(plain, CampaignSpec)


def test_kinds_have_the_names_of_the_manual() -> None:
    named = read({"kind": "rss_distance", "brake_mps2": 6.0}, {"kind": "r157_cut_in"})
    assert named.named_requirements == (SafeDistance(brake_mps2=6.0), PreventableCollision())


def test_no_requirement_is_as_good_as_no_collision_alone() -> None:
    plain = CampaignSpec(name="c", method="monte_carlo", episodes=1)
    assert plain.named_requirements == ()
    assert plain.is_like(read({"kind": "no_collision"}))
    assert not plain.is_like(read({"kind": "time_headway"}))
    assert (NoCollision(),) == COLLISION_ALONE


def test_a_campaign_that_names_none_has_the_text_that_it_always_had() -> None:
    plain = CampaignSpec(name="c", method="monte_carlo", episodes=1)
    assert b"requirements" not in msgspec.json.encode(plain)
    assert b"requirements" not in msgspec.json.encode(plain.setup())
