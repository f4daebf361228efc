"""Runs by version, and what can be judged against what."""

import pytest
from msgspec.structs import replace

from eigenfail.errors import Conflict, InvalidValue
from eigenfail.gate import baselines
from eigenfail.suites import SuiteMember
from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import CampaignSpec, StopRules
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.requirements import TimeHeadway

OTHER = {
    "name": "other",
    "method": "cem",
    "episodes": 11,
    "seed": 9,
    "settings": {"batch": 3},
    "scenario": "lead_brake",
    "scenario_parameters": {"distance_m": 53.0},
    "planner": "rulebook",
    "planner_settings": {"x": 1},
    "simulator": "point_mass",
    "disturbance": DisturbanceModel(scale=2.0),
    "requirements": (TimeHeadway(),),
    "importance": TimeHeadway(),
    "stop": StopRules(failures=1),
    "parallel": 7,
    "price_usd_per_hour": 9.0,
    "instances": 7,
    "scene_every": 3,
    "priority": "high",
    "planner_version": "v9",
    "project": "other",
    "tags": ("x",),
}


def test_versions_are_runs_of_their_own(suite, campaign):
    old, new = baselines.select_version(suite, "v1"), baselines.select_version(suite, "v2")
    assert new.name == "trio @ v2"
    assert new.members[0].spec.name == "trio @ v2: a"
    assert new.members[0].name == "a"
    assert new.members[0].spec.version == "v2"
    assert baselines.list_differences(old.members[0].spec, new.members[0].spec) == ()
    assert baselines.find_run(campaign(spec=old.members[0].spec), old.members[0]) == "trio @ v1"


@pytest.mark.parametrize("field", CampaignSpec.__struct_fields__)
def test_the_planner_may_differ_and_the_question_may_not(spec, suite, campaign, field):
    changed = campaign(spec=replace(spec, **{field: OTHER[field]}))
    if field in baselines.MAY_DIFFER:
        baselines.check_baseline(suite, {"a": changed}, "v1")
        return
    with pytest.raises(InvalidValue, match=rf"member 'a': {field} of campaign 1"):
        baselines.check_baseline(suite, {"a": changed}, "v1")


def test_a_baseline_must_be_there_and_done(suite, campaign):
    baselines.check_baseline(suite, {"a": campaign(failures=1)}, "v1")
    with pytest.raises(InvalidValue, match="'v1' contains no members of trio"):
        baselines.check_baseline(suite, {}, "v1")
    with pytest.raises(Conflict, match="Campaign 1 of the baseline is paused"):
        baselines.check_baseline(suite, {"a": campaign(state=CampaignState.PAUSED)}, "v1")
    with pytest.raises(Conflict, match="completed no episode"):
        baselines.check_baseline(suite, {"a": campaign(completed=0, errored=10)}, "v1")


def test_campaigns_belong_to_members_by_name_or_else_by_question(spec, campaign):
    member = SuiteMember("a", spec)
    by_name = campaign(3, spec=replace(spec, name="old: a", seed=5))
    alike = campaign(4, spec=replace(spec, name="anything", planner="rulebook"))
    unlike = campaign(5, spec=replace(spec, name="anything", seed=5))
    assert baselines.find_counterpart(member, [unlike, alike, by_name]) == by_name
    assert baselines.find_counterpart(member, [unlike, alike]) == alike
    assert baselines.find_counterpart(member, [unlike]) is None
    with pytest.raises(InvalidValue, match="campaigns 4, 6 could all be that of member 'a'"):
        baselines.find_counterpart(member, [alike, campaign(6, spec=alike.spec)])


@pytest.mark.parametrize(("number", "is_same"), [(7, True), (8, False)])
def test_a_member_that_builds_upon_another_asks_the_same_of_that_ones_baseline(
    suite, campaign, spec, number, is_same
):
    upon = SuiteMember("b", replace(spec, method="replay", settings={"campaign": "a"}))
    both = replace(suite, members=(*suite.members, upon))
    asked = replace(upon.spec, settings={"campaign": number})
    found = {"a": campaign(7), "b": campaign(9, spec=asked)}
    if is_same:
        baselines.check_baseline(both, found, "v1")
        return
    with pytest.raises(InvalidValue, match="settings of campaign 9"):
        baselines.check_baseline(both, found, "v1")
