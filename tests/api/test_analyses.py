"""Analyses over HTTP, and the replay of what they found."""

import msgspec
import pytest

from eigenfail.values import AnalysisSettings, CampaignSpec

URL = "/api/v1/analyses"


def test_an_analysis_is_queued_with_its_settings(http, campaign):
    url = f"/api/v1/campaigns/{campaign}/analyses"
    response = http.post(url, json={"align": "collision", "clusters": 4})
    assert response.status_code == 201
    assert response.json()["state"] == "queued"
    assert response.json()["settings"] == {"align": "collision", "components": 3, "clusters": 4}
    assert http.get(response.headers["Location"]).json() == response.json()


def test_nothing_in_the_body_means_the_defaults(http, campaign, read):
    response = http.post(f"/api/v1/campaigns/{campaign}/analyses")
    assert response.status_code == 201
    assert msgspec.convert(response.json()["settings"], AnalysisSettings) == AnalysisSettings()


@pytest.mark.parametrize("settings", [{"components": 0}, {"clusters": 51}, {"align": "end"}])
def test_settings_have_bounds(http, campaign, problem, settings):
    told = problem(http.post(f"/api/v1/campaigns/{campaign}/analyses", json=settings), 422)
    assert told["field"] == next(iter(settings))


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
    assert modes[2]["eigenfailure"][0][0] == -3.0


def test_a_replay_is_a_campaign_in_the_same_world(http, finished, fields, store):
    analysis = finished(2)
    response = http.post(f"{URL}/{analysis}/replay")
    assert response.status_code == 201
    spec = msgspec.convert(response.json()["spec"], CampaignSpec)
    assert (spec.method, spec.settings, spec.episodes) == ("replay", {"analysis": analysis}, 2)
    assert (spec.planner, spec.simulator) == (fields["planner"], fields["simulator"])
    assert str(analysis) in spec.name
    assert response.headers["Location"] == f"/api/v1/campaigns/{response.json()['id']}"
    assert store.analyses.get(analysis).replay_campaign == response.json()["id"]


def test_a_replay_is_not_cut_short_by_the_rules_of_the_campaign_it_came_from(
    http, finished, fields
):
    ruled = http.post("/api/v1/campaigns", json=fields | {"stop": {"failures": 1}}).json()["id"]
    spec = http.post(f"{URL}/{finished(of=ruled)}/replay").json()["spec"]
    assert spec["stop"] == dict.fromkeys(["failures", "half_width", "cv", "wall_s", "cost_usd"])


def test_a_replay_may_vary_the_scenario(http, finished):
    body = {"name": "five metres further", "scenario_parameters": {"distance_m": 63.0}}
    spec = http.post(f"{URL}/{finished()}/replay", json=body).json()["spec"]
    assert spec["name"] == "five metres further"
    assert spec["scenario_parameters"] == {"distance_m": 63.0}


def test_a_variation_outside_the_scenario_is_refused(http, finished, problem, store):
    analysis, before = finished(), len(store.campaigns.page(10).items)
    body = {"scenario_parameters": {"distance": 63.0}}
    told = problem(http.post(f"{URL}/{analysis}/replay", json=body), 422)
    assert "distance_m" in told["known"]
    assert len(store.campaigns.page(10).items) == before


def test_one_key_makes_one_replay(http, finished):
    analysis, key = finished(), {"Idempotency-Key": "once"}
    ids = {http.post(f"{URL}/{analysis}/replay", headers=key).json()["id"] for _ in range(2)}
    assert len(ids) == 1


def test_the_name_of_a_replay_fits_even_where_the_campaigns_is_long(http, finished, fields):
    named = http.post("/api/v1/campaigns", json={**fields, "name": "n" * 200}).json()["id"]
    analysis = finished(of=named)
    name = http.post(f"{URL}/{analysis}/replay").json()["spec"]["name"]
    assert len(name) == 200
    assert name.endswith(f"analysis {analysis}")


@pytest.mark.parametrize("what", ["eigenfailures", "replay"])
def test_what_is_not_done_yet_has_nothing_to_give(http, campaign, problem, what):
    analysis = http.post(f"/api/v1/campaigns/{campaign}/analyses").json()["id"]
    ask = {"eigenfailures": http.get, "replay": http.post}[what]
    told = problem(ask(f"{URL}/{analysis}/{what}"), 409)
    assert "queued" in told["detail"]
    assert told["remedy"]


def test_why_an_analysis_failed_is_told_with_every_refusal(http, campaign, store, problem):
    analysis = http.post(f"/api/v1/campaigns/{campaign}/analyses").json()["id"]
    store.analyses.start(analysis)
    store.analyses.fail(analysis, "There are no failures to analyse.")
    told = problem(http.get(f"{URL}/{analysis}/eigenfailures"), 409)
    assert "There are no failures to analyse." in told["detail"]


def test_nothing_found_is_nothing_to_replay(http, finished, problem):
    told = problem(http.post(f"{URL}/{finished(0)}/replay"), 409)
    assert "no failure mode" in told["detail"]
