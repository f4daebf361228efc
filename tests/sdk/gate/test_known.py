"""Known failures and the campaigns that inject them: each in its own scenario."""

import numpy as np
import pytest
from example_values import make_findings
from msgspec.structs import replace

from eigenfail.gate.known import (
    RunSettings,
    drop_unproven,
    is_minimal_search,
    make_minimal_replay,
    make_mode_replays,
)
from eigenfail.suites import SuiteMember
from eigenfail.values.analysis import (
    Analysis,
    AnalysisSettings,
    AnalysisState,
    FailureMode,
)
from eigenfail.values.campaign_spec import StopRules
from eigenfail.values.episode import Outcome


@pytest.fixture
def analysis():
    """Three modes whose medoids are the episodes 4, 7 and 9."""
    modes = tuple(FailureMode(2, medoid, np.zeros(1), np.zeros((3, 2))) for medoid in (4, 7, 9))
    result = make_findings(modes=modes)
    return Analysis(5, 1, AnalysisSettings(), AnalysisState.DONE, 0, result)


@pytest.fixture
def under(spec):
    return RunSettings(
        "trio @ v2", SuiteMember("a", replace(spec, planner="mine", planner_settings={"x": 1}))
    )


def test_in_one_scenario_all_modes_share_a_campaign(under, campaign, analysis, spec):
    spec = replace(spec, stop=StopRules(failures=2), scenario_parameters={"distance_m": 53.0})
    eigenfailures, medoids = make_mode_replays(under, campaign(1, spec=spec), analysis)
    assert eigenfailures.member.spec == replace(
        spec,
        name="trio @ v2: a: eigenfailures of analysis 5",
        method="replay",
        settings={"analysis": 5},
        episodes=3,
        planner="mine",
        planner_settings={"x": 1},
        stop=StopRules(),
        scene_every=1,
    )
    assert medoids.member.spec.settings == {"campaign": 1, "episodes": [4, 7, 9]}
    assert medoids.member.name == "a: medoids of analysis 5"
    assert [known.what for known in eigenfailures.known.values()] == [
        f"eigenfailure {n} of analysis 5" for n in (1, 2, 3)
    ]
    assert [known.was for known in medoids.known.values()] == ["1/4", "1/7", "1/9"]
    assert {known.before for known in eigenfailures.known.values()} == {None}
    assert {known.before for known in medoids.known.values()} == {Outcome.COLLISION}


def test_where_parameters_vary_each_failure_is_replayed_as_its_medoid_drew_them(
    under, campaign, analysis, spec
):
    varied = {"distance_m": {"choice": [53.0, 63.0]}, "lane_change_s": 3.0}
    before = campaign(1, spec=replace(spec, scenario_parameters=varied))
    drawn = zip(analysis.result.modes, (53.0, 63.0, 53.0), strict=True)
    modes = tuple(replace(mode, drawn={"distance_m": one}) for mode, one in drawn)
    drew = replace(analysis, result=replace(analysis.result, modes=modes))
    found = list(make_mode_replays(under, before, drew))
    assert [each.member.spec.scenario_parameters["distance_m"] for each in found] == [
        *(53.0, 53.0),
        *(63.0, 63.0),
    ]
    assert {each.member.spec.scenario_parameters["lane_change_s"] for each in found} == {3.0}
    assert [list(each.known) for each in found] == [[0, 2], [0, 1], [1], [0]]
    assert [each.was for each in found[1].known.values()] == ["1/4", "1/9"]
    assert found[2].member.name == "a: eigenfailures of analysis 5 as in 1/7"
    assert len({each.member.name for each in found}) == 4


def test_the_minimal_failure_is_the_one_that_its_campaign_tells(under, campaign, spec):
    minimal = campaign(8, spec=replace(spec, method="minimal", settings={"campaign": 1}))
    found = make_minimal_replay(under, minimal, 3, {"distance_m": 53.0})
    assert found.member.spec.scenario_parameters == {"distance_m": 53.0}
    assert found.member.spec.settings == {"campaign": 8, "episodes": [3]}
    assert found.member.spec.planner == "mine"
    assert found.known[0].was == "8/3"


def test_what_was_shrunk_of_the_baseline_is_known(campaign, analysis, spec):
    before = campaign(1)

    def shrunk(**fields):
        given = {"method": "minimal", "settings": {"campaign": 1, "episode": 4}, **fields}
        return is_minimal_search(campaign(8, spec=replace(spec, **given)), before, analysis)

    assert shrunk()
    assert shrunk(settings={"analysis": 5, "mode": 1})
    assert not shrunk(settings={"campaign": 2})
    assert not shrunk(method="replay")
    assert not shrunk(planner_settings={"x": 1})


def test_the_baselines_own_replay_says_what_is_known(under, campaign, analysis):
    eigenfailures, medoids = make_mode_replays(under, campaign(1), analysis)
    outcomes = {0: Outcome.COLLISION, 1: Outcome.SAFE}
    told = drop_unproven(eigenfailures, outcomes)
    assert [known.before for known in told.known.values()] == ["collision", "safe", None]
    told = drop_unproven(medoids, outcomes)
    assert [known.before for known in told.known.values()] == ["collision", "safe", "collision"]
