"""Analyses over HTTP, and the replay of what they found."""

import msgspec
import numpy as np
import pytest

from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.campaign_spec import StopRules
from eigenfail.values.episode import Outcome

URL = "/api/v1/analyses"


def test_an_analysis_is_queued_with_its_settings(http, campaign):
    url = f"/api/v1/campaigns/{campaign}/analyses"
    response = http.post(url, json={"align": "collision", "clusters": 4})
    assert response.status_code == 201
    assert response.json()["state"] == "queued"
    settings = msgspec.convert(response.json()["settings"], AnalysisSettings)
    assert settings == AnalysisSettings("collision", clusters=4)
    assert http.get(response.headers["Location"]).json() == response.json()


@pytest.mark.parametrize(
    ("settings", "field"),
    [
        ({"components": 0}, "components"),
        ({"clusters": 51}, "clusters"),
        ({"align": "end"}, "align"),
        ({"features": "x"}, "features"),
        ({"campaigns": [99]}, "campaigns"),
        ({"clusterer": "hdbscan", "clusters": 3}, "clusters"),
    ],
)
def test_what_could_not_be_analysed_is_refused_at_once(http, campaign, problem, settings, field):
    told = problem(http.post(f"/api/v1/campaigns/{campaign}/analyses", json=settings), 422)
    assert told["field"] == field


def test_the_list_of_a_campaign_leaves_results_out(http, campaign, finished):
    ids = [finished(), finished()]
    items = http.get(f"/api/v1/campaigns/{campaign}/analyses").json()["items"]
    assert [item["id"] for item in items] == ids[::-1]
    assert all(item["result"] is None for item in items)


def test_a_finished_analysis_carries_its_arrays(http, finished):
    body = http.get(f"{URL}/{finished()}").json()
    assert body["state"] == "done"
    assert body["result"]["components"][0][0] == [-1.0, pytest.approx(-5 / 7)]


def test_eigenfailures_are_noise_ready_to_inject(http, finished):
    modes = http.get(f"{URL}/{finished(3)}/eigenfailures").json()["items"]
    assert [mode["medoid"] for mode in modes] == [0, 1, 2]
    assert [mode["number"] for mode in modes] == [1, 2, 3]
    assert modes[2]["eigenfailure"][0][0] == -3.0


def prove(http, analysis, *variations):
    body = {"variations": list(variations)} if variations else {}
    response = http.post(f"{URL}/{analysis}/proof", json=body)
    assert response.status_code == 202, response.text
    return response.json()


def test_a_proof_replays_in_the_same_scenario_and_to_both_sides_of_it(
    http, finished, fields, store
):
    analysis = finished(2)
    asked = prove(http, analysis)
    parameters = [each["scenario_parameters"] for each in asked["scenarios"]]
    assert parameters == [{}, {"distance_m": 53.0}, {"distance_m": 63.0}]
    replays = [each["campaign"] for each in asked["scenarios"]]
    assert store.analyses.replays(analysis) == tuple(replays)
    for number, given in zip(replays, parameters, strict=True):
        spec = store.campaigns.get(number).spec
        assert (spec.method, spec.episodes, spec.scene_every) == ("replay", 4, 1)
        assert spec.settings == {"analysis": analysis, "what": ["eigenfailure", "medoid"]}
        assert (spec.planner, spec.simulator) == (fields["planner"], fields["simulator"])
        assert spec.scenario_parameters == given
        assert f"analysis {analysis}" in spec.name
    assert (asked["done"], asked["reproduced"]["rate"]) == (False, None)


def test_a_replay_is_not_cut_short_by_the_rules_of_the_campaign_it_came_from(
    http, finished, fields, store
):
    ruled = http.post("/api/v1/campaigns", json=fields | {"stop": {"failures": 1}}).json()["id"]
    (scenario,) = prove(http, finished(of=ruled), {})["scenarios"]
    assert store.campaigns.get(scenario["campaign"]).spec.stop == StopRules()


def test_what_the_campaign_has_anyway_is_no_variation(http, finished):
    asked = prove(http, finished(), {"distance_m": 58.0}, {}, {"distance_m": 60.0})
    assert [each["scenario_parameters"] for each in asked["scenarios"]] == [
        {},
        {"distance_m": 60.0},
    ]


@pytest.mark.parametrize(
    ("variations", "field"),
    [
        ([{"distance": 63.0}], "scenario_parameters"),
        ([{"distance_m": 60.0}, {"distance_m": 1.0}], "scenario_parameters.distance_m"),
        ([{"distance_m": {"uniform": [52, 60]}}], "variations[0].distance_m"),
        ([], "variations"),
        ([3], "variations[0]"),
    ],
)
def test_a_variation_outside_the_scenario_is_refused_and_nothing_is_queued(
    *, http, finished, problem, store, variations, field
):
    analysis, before = finished(), len(store.campaigns.page(10).items)
    told = problem(http.post(f"{URL}/{analysis}/proof", json={"variations": variations}), 422)
    assert told["field"] == field
    assert len(store.campaigns.page(10).items) == before


def test_what_is_asked_twice_is_replayed_once(http, finished, store):
    analysis = finished()
    first = prove(http, analysis)
    assert prove(http, analysis) == first
    wider = prove(http, analysis, {}, {"distance_m": 61.0})
    assert [each["campaign"] for each in wider["scenarios"]][:3] == [
        each["campaign"] for each in first["scenarios"]
    ]
    assert len(wider["scenarios"]) == 4
    assert len(store.analyses.replays(analysis)) == 4


def test_a_replay_that_came_to_nothing_is_tried_again_and_counts_once(
    http, finished, store, deliver, result
):
    analysis = finished(1)
    (lost,) = prove(http, analysis, {})["scenarios"]
    deliver(lost["campaign"], result(0, Outcome.COLLISION))
    store.campaigns.move(lost["campaign"], "cancelling")
    store.campaigns.move(lost["campaign"], "cancelled")
    assert http.get(f"{URL}/{analysis}/proof").json()["done"]
    (again,) = prove(http, analysis, {})["scenarios"]
    assert again["campaign"] != lost["campaign"]
    told = http.get(f"{URL}/{analysis}/proof").json()
    assert (len(told["scenarios"]), told["reproduced"]["rate"]) == (1, None)


def test_it_tells_of_every_replay_and_sums_up(http, finished, deliver, result, failed):
    analysis = finished(2)
    here, there = prove(http, analysis, {}, {"distance_m": 60.0})["scenarios"]
    crash, safe = result(0, Outcome.COLLISION), result(1)
    deliver(here["campaign"], crash, safe, result(2, Outcome.COLLISION), failed(3))
    deliver(there["campaign"], result(0), result(1), result(2, Outcome.COLLISION))
    told = http.get(f"{URL}/{analysis}/proof").json()

    def k_of_n(reproduction):
        return reproduction["rate"]["k"], reproduction["rate"]["n"]

    assert k_of_n(told["reproduced"]) == (1, 2)
    assert k_of_n(told["eigenfailures"]) == (1, 4)
    assert k_of_n(told["medoids"]) == (2, 2)
    assert told["eigenfailures"]["smallest_robustness_m"] == 0.0
    first, second = told["modes"]
    assert (k_of_n(first["eigenfailure"]), k_of_n(second["eigenfailure"])) == ((1, 2), (0, 2))
    assert second["eigenfailure"]["smallest_robustness_m"] == 3.5
    assert second["medoid"] == {"rate": None, "smallest_robustness_m": None}
    replays = told["scenarios"][0]["replays"]
    assert [(one["what"], one["mode"], one["outcome"]) for one in replays] == [
        ("eigenfailure", 0, "collision"),
        ("eigenfailure", 1, "safe"),
        ("medoid", 0, "collision"),
        ("medoid", 1, "failed"),
    ]
    assert replays[0]["log_probability"] == pytest.approx(crash.noise.log_probability)
    assert replays[0]["log_probability_per_step"] == pytest.approx(
        crash.noise.log_probability / crash.steps
    )
    # sigma is 1 there: -log(2 pi e) for a step of two axes.
    assert replays[0]["expected_log_probability"] == pytest.approx(
        -crash.steps * np.log(2 * np.pi * np.e)
    )
    assert told["scenarios"][1]["replays"][3]["outcome"] is None


def test_the_name_of_a_replay_fits_even_where_the_campaigns_is_long(http, finished, fields, store):
    named = http.post("/api/v1/campaigns", json={**fields, "name": "n" * 200}).json()["id"]
    analysis = finished(of=named)
    (scenario,) = prove(http, analysis, {"distance_m": 60.5})["scenarios"]
    name = store.campaigns.get(scenario["campaign"]).spec.name
    assert len(name) == 200
    assert name.endswith(f"analysis {analysis}, distance_m=60.5")


@pytest.mark.parametrize(
    ("what", "method"), [("eigenfailures", "GET"), ("proof", "GET"), ("proof", "POST")]
)
def test_what_is_not_done_yet_has_nothing_to_give(http, campaign, problem, what, method):
    analysis = http.post(f"/api/v1/campaigns/{campaign}/analyses").json()["id"]
    told = problem(http.request(method, f"{URL}/{analysis}/{what}"), 409)
    assert "queued" in told["detail"]
    assert told["remedy"]


def test_why_an_analysis_failed_is_told_with_every_refusal(http, campaign, store, problem):
    analysis = http.post(f"/api/v1/campaigns/{campaign}/analyses").json()["id"]
    store.analyses.start(analysis)
    store.analyses.fail(analysis, "There are no failures to analyse.")
    told = problem(http.get(f"{URL}/{analysis}/eigenfailures"), 409)
    assert "There are no failures to analyse." in told["detail"]


def test_nothing_found_is_nothing_to_replay(http, finished, problem):
    told = problem(http.post(f"{URL}/{finished(0)}/proof"), 409)
    assert "no failure mode" in told["detail"]
