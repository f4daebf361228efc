"""Episodes and failure modes as files of other tools, over HTTP and on their pages."""

import numpy as np
import pytest
from accepted import accept_spec
from msgspec.structs import replace
from store_checks.examples import analyse_function
from tiny_formats import FORMATS, PIXEL

from eigenfail import plugins
from eigenfail.errors import Conflict
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeTask, Outcome, PriorSource
from eigenfail.values.proof import Explanation, Replayed
from eigenfail_api.routes import recordings
from eigenfail_services.campaigns import recordings as recorded


@pytest.fixture
def played(store, deliver):
    """Runs an episode of a campaign and stores it with or without its scene: campaign, result."""

    def make(keep=True, **fields):
        wanted = {"name": "played", "method": "monte_carlo", "episodes": 9, "planner": "idm"}
        spec = CampaignSpec(**wanted | {"simulator": "point_mass", "scene_every": 1} | fields)
        campaign = store.campaigns.create(accept_spec(spec)).id
        engine = plugins.load(plugins.ENGINES, "default")(spec.setup())
        (result,) = engine.run([EpisodeTask(0, 5, PriorSource())])
        deliver(campaign, result if keep else replace(result, scene=None))
        return campaign, result

    return make


def fetch(http, campaign, index=0, **asked):
    return http.get(f"/api/v1/campaigns/{campaign}/episodes/{index}/recording", params=asked)


@pytest.mark.parametrize("form", FORMATS)
def test_an_episode_is_a_file_of_each_format(http, played, form):
    campaign, _ = played()
    response = fetch(http, campaign, format=form)
    assert response.status_code == 200, response.text
    assert response.headers["content-type"] == FORMATS[form].media_type
    name = f'filename="episode-{campaign}-0{FORMATS[form].suffix}"'
    assert name in response.headers["content-disposition"]


def test_a_format_is_given_scene_and_lanes_of_the_episode(http, played):
    campaign, result = played(scenario="merge_in", scenario_parameters={"ramp_m": 400.0})
    told = fetch(http, campaign, format="poses").json()
    assert np.array_equal(told["poses"], np.nan_to_num(result.scene.vehicles))
    assert (told["lanes"], told["ego"]) == (2, "recorded")


def test_the_ego_may_be_left_to_a_controller(http, played, problem):
    campaign, _ = played()
    left = fetch(http, campaign, format="poses", ego="controller")
    assert left.json()["ego"] == "controller"
    told = problem(fetch(http, campaign, format="gif", ego="controller"), 422)
    assert told["field"] == "ego"


def test_an_episode_with_too_many_poses_is_refused(http, played, problem, monkeypatch):
    campaign, result = played()
    steps, vehicles = result.scene.vehicles.shape[:2]
    monkeypatch.setattr(recorded, "MAX_POSES", steps * vehicles - 1)
    told = problem(fetch(http, campaign, format="gif"), 422)
    assert f"{steps * vehicles} poses" in told["detail"]


def test_what_no_episode_has_is_refused_before_one_is_run_again(http, played, problem, monkeypatch):
    campaign, _ = played(keep=False)

    def refuse(*_):
        pytest.fail("The episode was run again.")

    monkeypatch.setattr(recordings.EXPLANATIONS, "of", refuse)
    told = problem(fetch(http, campaign, format="gif", ego="controller"), 422)
    assert told["field"] == "ego"


def test_the_lanes_of_a_bridge_are_not_those_of_a_scenario_of_the_same_name(played):
    _, result = played(scenario="cut_in")
    spec = CampaignSpec(name="a", scenario="cut_in", method="monte_carlo", episodes=1)
    assert recorded.find_mission(spec, result) is not None
    assert recorded.find_mission(replace(spec, simulator="bridge"), result) is None


def test_an_episode_without_a_scene_is_run_again(http, played):
    campaign, result = played(keep=False)
    poses = fetch(http, campaign, format="poses").json()["poses"]
    assert np.array_equal(poses, np.nan_to_num(result.scene.vehicles))


def test_a_replay_that_differs_gives_no_scene(http, played, problem, monkeypatch):
    campaign, result = played(keep=False)
    verdict = Replayed(0, result.outcome, "a", result.outcome, "b", same=False)
    told = Explanation("1/0", "idm", verdict, "", "", (), ())
    monkeypatch.setattr(recordings.EXPLANATIONS, "of", lambda *_: told)
    assert "differs" in problem(fetch(http, campaign, format="gif"), 409)["detail"]


def test_what_cannot_be_asked_for_is_refused(http, played, problem):
    done, _ = played()
    assert problem(fetch(http, done, format="mp4"), 422)["field"] == "format"
    assert problem(fetch(http, done), 422)["field"] == "format"
    assert problem(fetch(http, done, format="gif", ego="me"), 422)["field"] == "ego"
    assert problem(fetch(http, done, format="gif", speed="2"), 422)
    problem(fetch(http, done, index=7, format="gif"), 404)
    problem(fetch(http, 99, format="gif"), 404)


def test_an_episode_that_never_ran_is_refused(http, campaign, deliver, failed, problem):
    deliver(campaign, failed(0))
    assert "It raised." in problem(fetch(http, campaign, format="gif"), 422)["detail"]


def test_a_function_has_no_vehicles(http, store, problem):
    campaign, analysis = analyse_function(store, ("a", "b"))
    told = problem(fetch(http, campaign, format="poses"), 422)
    assert "no vehicles" in told["detail"]
    told = problem(http.get(f"/api/v1/analyses/{analysis}/modes/1/animation"), 422)
    assert (told["field"], "no vehicles" in told["detail"]) == ("mode", True)
    assert "animation" not in http.get(f"/analyses/{analysis}").text
    assert "recording?" not in http.get(f"/campaigns/{campaign}/episodes/0").text


def test_a_format_that_is_not_installed_is_refused_and_not_offered(http, played, problem):
    campaign, _ = played()
    told = problem(fetch(http, campaign, format="mcap"), 422)
    assert "pip install plugins/" in told["remedy"]
    assert "Installed formats: gif, poses." in told["remedy"]
    page = http.get(f"/campaigns/{campaign}/episodes/0").text
    assert "recording?format=mcap" not in page
    assert "recording?format=poses" in page


@pytest.fixture
def three_modes(campaign, deliver, result, finished):
    """An analysis of three failures, each of them a mode; its id."""
    deliver(campaign, *(result(index, Outcome.COLLISION) for index in range(3)))
    return finished(3)


def test_without_a_format_for_modes_pages_offer_no_animation(http, three_modes, formats, problem):
    analysis = three_modes
    pages = (f"/analyses/{analysis}", f"/analyses/{analysis}/modes/1")
    assert all("/animation" in http.get(page).text for page in pages)
    del formats["gif"]
    assert not any("/animation" in http.get(page).text for page in pages)
    told = problem(http.get(f"/api/v1/analyses/{analysis}/modes/1/animation"), 422)
    assert "pip install plugins/" in told["remedy"]
    address = f"/api/v1/analyses/{analysis}/modes/1/animation?format=poses"
    assert "over each other" in problem(http.get(address), 422)["detail"]


def test_the_failures_of_a_mode_are_one_animation(http, three_modes):
    analysis = three_modes
    response = http.get(f"/api/v1/analyses/{analysis}/modes/2/animation")
    assert response.status_code == 200, response.text
    assert response.headers["content-type"] == "image/gif"
    assert f"analysis-{analysis}-mode-2.gif" in response.headers["content-disposition"]
    assert response.content == PIXEL + bytes(1)
    assert (
        f"/api/v1/analyses/{analysis}/modes/2/animation" in http.get(f"/analyses/{analysis}").text
    )


def test_a_mode_that_is_not_there_is_not_found(http, store, campaign, finished, problem):
    told = problem(http.get(f"/api/v1/analyses/{finished(2)}/modes/3/animation"), 404)
    assert "eigenfail mode list" in told["remedy"]
    queued = store.analyses.create(campaign, AnalysisSettings()).id
    problem(http.get(f"/api/v1/analyses/{queued}/modes/1/animation"), 409)
    problem(http.get("/api/v1/analyses/99/modes/1/animation"), 404)


@pytest.fixture
def large_mode(store, campaign, deliver, result, finished):
    """An analysis of nine failures, all of one mode."""
    deliver(campaign, *(result(index, Outcome.COLLISION) for index in range(9)))
    analysis = store.analyses.get(finished(1))
    found = replace(
        analysis.result,
        episodes=tuple(range(9)),
        labels=(0,) * 9,
        scores=np.ones((9, 1), np.float32),
        modes=(replace(analysis.result.modes[0], failures=9, medoid=4),),
    )
    return replace(analysis, result=found)


def test_of_a_large_mode_a_sample_is_drawn_with_its_medoid(store, large_mode, monkeypatch):
    whole = recorded.load_mode_recordings(store, large_mode, 1)
    monkeypatch.setattr(recorded, "MAX_OVERLAID", 3)
    sample = recorded.load_mode_recordings(store, large_mode, 1)
    assert (len(whole.scenes), len(sample.scenes), sample.total) == (9, 3, 9)
    scenes = [store.episodes.get(large_mode.campaign, index).scene for index in (4, 0, 8)]
    for found, wanted in zip(sample.scenes, scenes, strict=True):
        assert np.array_equal(found.vehicles, wanted.vehicles)


@pytest.mark.parametrize("bound", ["MAX_DRAWN_POSES", "MAX_KEPT_POSES"])
def test_of_scenes_with_many_poses_fewer_are_read_and_drawn(store, large_mode, monkeypatch, bound):
    (medoid,) = recorded.load_mode_recordings(store, large_mode, 1).scenes[:1]
    poses = medoid.vehicles.shape[0] * medoid.vehicles.shape[1]
    monkeypatch.setattr(recorded, bound, 3 * poses)
    sample = recorded.load_mode_recordings(store, large_mode, 1)
    assert (len(sample.scenes), sample.total) == (3, 9)
    wanted = [store.episodes.get(large_mode.campaign, index).scene for index in (4, 0, 8)]
    assert [each.vehicles.tolist() for each in sample.scenes] == [
        each.vehicles.tolist() for each in wanted
    ]
    monkeypatch.setattr(recorded, bound, poses - 1)
    with pytest.raises(Conflict, match="has a scene that can be drawn"):
        recorded.load_mode_recordings(store, large_mode, 1)


def test_a_failure_with_more_poses_than_the_medoid_is_left_out(store, large_mode, monkeypatch):
    """The number that is drawn follows from the medoid, whose scene may be the smallest."""
    read = store.episodes.get
    long = read(large_mode.campaign, 4).scene.vehicles.repeat(9, axis=0)

    def lengthen(campaign, index):
        result = read(campaign, index)
        return replace(result, scene=replace(result.scene, vehicles=long)) if index == 3 else result

    monkeypatch.setattr(store.episodes, "get", lengthen)
    monkeypatch.setattr(recorded, "MAX_KEPT_POSES", long.shape[0] * long.shape[1])
    shown = recorded.load_mode_recordings(store, large_mode, 1).scenes
    assert [len(each.vehicles) for each in shown] == [len(long) // 9] * 8
