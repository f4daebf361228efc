"""Campaigns before they are launched over HTTP: checked, cloned, and many at once."""

import msgspec
import pytest

from eigenfail.bridges import BridgeOffer, OfferedPlanner, OfferedScenario
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.operations import Arrival
from eigenfail.wire.http import MAX_CAMPAIGNS_AT_ONCE

URL = "/api/v1/campaigns"


def fields_of(response):
    return [problem.get("field", "") for problem in response.json()["problems"]]


def test_a_check_tells_all_that_a_campaign_would_be_and_launches_nothing(http, fields, store):
    given = {**fields, "method": "cem", "settings": {"batch": 7}}
    given["scenario_parameters"] = {"distance_m": {"uniform": [53, 60]}}
    response = http.post(f"{URL}/check", json=given)
    assert response.status_code == 200
    assert response.json()["problems"] == []
    spec = response.json()["spec"]
    assert spec["settings"]["batch"] == 7
    assert spec["settings"]["elite_share"] == 0.1
    assert spec["scenario_parameters"]["distance_m"] == {"uniform": [53, 60]}
    assert spec["scenario_parameters"]["final_offset_m"] == 2.1
    assert spec["planner_settings"]["gaps"]["foresight_s"] == 20.0
    assert store.campaigns.page(10).items == ()


def test_what_a_check_completes_is_itself_in_order(http, fields):
    first = http.post(f"{URL}/check", json={**fields, "method": "ast"}).json()["spec"]
    again = http.post(f"{URL}/check", json=first).json()
    assert again["spec"] == first


def test_a_check_tells_every_problem_at_once(http, fields):
    wrong = {
        **fields,
        "name": "",
        "method": "cem",
        "episodes": "many",
        "seed": -1,
        "settings": {"batch": 1, "max_std": 20, "bogus": 1},
        "scenario_parameters": {"distance_m": {"uniform": [60, 53]}, "ego_speed_mps": 99},
        "disturbance": {"scale": 0, "shape": {"kind": "pink"}},
        "stop": {"cv": 11},
    }
    found = fields_of(http.post(f"{URL}/check", json=wrong))
    assert sorted(found) == [
        "disturbance.scale",
        "disturbance.shape.kind",
        "episodes",
        "name",
        "scenario_parameters.distance_m.uniform",
        "scenario_parameters.ego_speed_mps",
        "seed",
        "settings",
        "settings.batch",
        "settings.max_std",
        "stop.cv",
    ]


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"method": "magic", "settings": {"alpha": 1}}, ["method"]),
        ({"planner": "nobody", "planner_settings": {"x": 1}}, ["planner"]),
        ({"method": "evaluate"}, ["settings.campaign"]),
        ({"method": "evaluate", "settings": {"campaign": 77}}, ["settings.campaign"]),
        ({"method": "replay"}, ["settings"]),
        ({"bogus": 1}, [""]),
        ({"stop": {"cv": 0.1}}, ["stop.cv"]),
    ],
)
def test_one_fault_is_one_problem(http, fields, change, expected):
    assert fields_of(http.post(f"{URL}/check", json={**fields, **change})) == expected


def test_what_a_check_finds_first_is_what_a_launch_is_refused_for(http, fields, problem):
    wrong = {**fields, "settings": {"round_size": 0}}
    told = problem(http.post(URL, json=wrong), 422)
    (found,) = http.post(f"{URL}/check", json=wrong).json()["problems"]
    assert {name: told[name] for name in ("type", "detail", "field")} == {
        name: found[name] for name in ("type", "detail", "field")
    }


def test_a_check_says_how_late_a_stop_rule_may_come(http, fields):
    given = {**fields, "episodes": 1000, "stop": {"failures": 10}}
    (note,) = http.post(f"{URL}/check", json=given).json()["notes"]
    assert "failures = 10" in note
    assert "whole rounds, of 100 episodes" in note
    assert http.post(f"{URL}/check", json=fields).json()["notes"] == []


def test_an_empty_check_names_what_is_required(http):
    assert set(fields_of(http.post(f"{URL}/check"))) == {"name", "method", "episodes"}


def test_a_clone_differs_in_what_was_changed_alone(http, fields, store):
    given = {**fields, "method": "cem", "settings": {"batch": 7, "max_mean": 3.0}}
    first = http.post(URL, json=given).json()["id"]
    response = http.post(
        f"{URL}/{first}/clone", json={"episodes": 20, "settings": {"batch": 9}, "stop": {"cv": 1.0}}
    )
    assert response.status_code == 201
    assert response.headers["Location"] == f"{URL}/{response.json()['id']}"
    wanted = {**given, "episodes": 20, "settings": {"batch": 9, "max_mean": 3.0}}
    wanted["stop"] = {"cv": 1.0}
    clone = store.campaigns.get(response.json()["id"]).spec
    assert clone == CampaignSpec(**{**wanted, "stop": clone.stop})
    assert clone.stop.cv == 1.0


def test_a_clone_with_another_method_leaves_the_settings_behind(http, fields, store):
    given = {**fields, "method": "cem", "settings": {"batch": 7}}
    first = http.post(URL, json=given).json()["id"]
    clone = http.post(f"{URL}/{first}/clone", json={"method": "monte_carlo"}).json()["id"]
    assert store.campaigns.get(clone).spec.settings == {}


def test_clones_are_made_once_for_a_key_and_refused_like_campaigns(http, campaign, problem, store):
    key = {"Idempotency-Key": "k"}
    made = {http.post(f"{URL}/{campaign}/clone", json={}, headers=key).json()["id"] for _ in "ab"}
    assert len(made) == 1
    assert problem(http.post(f"{URL}/{campaign}/clone", json={"seed": -1}), 422)["field"] == "seed"
    problem(http.post(f"{URL}/99/clone", json={}), 404)
    assert len(store.campaigns.page(10).items) == 2


def test_many_are_created_in_order(http, fields, store):
    response = http.post(f"{URL}/bulk", json=[{**fields, "seed": seed} for seed in range(3)])
    assert response.status_code == 201
    items = response.json()["items"]
    assert [item["spec"]["seed"] for item in items] == [0, 1, 2]
    assert [item["id"] for item in items] == sorted(item["id"] for item in items)
    assert len(store.campaigns.page(10).items) == 3


@pytest.mark.parametrize(
    ("wrong", "field"),
    [
        ({"seed": -1}, "[1].seed"),
        ({"settings": {"bogus": 1}}, "[1].settings"),
        ({"method": "magic"}, "[1].method"),
        (None, "[1]"),
    ],
)
def test_one_that_is_wrong_keeps_all_from_being_created(http, fields, problem, wrong, field):
    item = {**fields, **wrong} if wrong else wrong
    told = problem(http.post(f"{URL}/bulk", json=[fields, item, fields]), 422)
    assert told["field"] == field
    assert told["detail"].startswith(f"{field}: ")
    assert http.get(URL).json()["items"] == []


def test_one_key_makes_many_campaigns_once(http, fields, store, problem):
    key = {"Idempotency-Key": "k" * 200}
    items = [{**fields, "seed": seed} for seed in range(3)]
    first, second = (http.post(f"{URL}/bulk", json=items, headers=key).json() for _ in range(2))
    assert first == second
    assert len(store.campaigns.page(10).items) == 3
    changed = [{**fields, "seed": 5}, *items[1:]]
    problem(http.post(f"{URL}/bulk", json=changed, headers=key), 409)


ON_BRIDGE = {
    "name": "n",
    "method": "monte_carlo",
    "episodes": 10,
    "simulator": "bridge",
    "scenario": "wet",
    "planner": "careful",
    "scenario_parameters": {"steps": 80},
    "disturbance": {"channels": [{"name": "missed"}]},
}


@pytest.fixture
def offer(store):
    """Let a worker report that its bridge offers one scenario and one planner."""
    (worker,) = store.roster.arrived([Arrival(worker="w", host="h", pid=1)])

    def report(scenario="wet", planner="careful"):
        offered = BridgeOffer(
            "theirs",
            "1",
            (OfferedScenario(scenario, 0.1, 80),),
            (OfferedPlanner(planner),),
            ("missed",),
        )
        store.roster.set_offers({worker: msgspec.json.encode(offered).decode()})

    return report


@pytest.mark.fault("same POST twice with one idempotency key")
@pytest.mark.parametrize("path", ["", "/bulk", "/1/clone"])
def test_a_repeated_launch_does_not_depend_on_the_bridges_of_now(http, offer, problem, path):
    http.post(URL, json=ON_BRIDGE)
    body = {"": ON_BRIDGE, "/bulk": [ON_BRIDGE, ON_BRIDGE], "/1/clone": {}}[path]
    key = {"Idempotency-Key": "k"}
    offer()
    first = http.post(URL + path, json=body, headers=key)
    assert first.status_code == 201
    offer(scenario="dry")
    assert http.post(URL + path, json=body, headers=key).json() == first.json()
    told = problem(http.post(URL + path, json=body, headers={"Idempotency-Key": "another"}), 422)
    assert told["field"].endswith("scenario")


def test_a_list_names_the_campaign_that_fits_no_bridge_and_asks_once(
    http, offer, problem, store, monkeypatch
):
    asked = []
    list_offers = store.roster.list_offers
    monkeypatch.setattr(store.roster, "list_offers", lambda: asked.append(1) or list_offers())
    offer()
    items = [ON_BRIDGE, ON_BRIDGE, ON_BRIDGE | {"planner": "carefull"}]
    told = problem(http.post(f"{URL}/bulk", json=items), 422)
    assert told["field"] == "[2].planner"
    assert "not known to the bridge 'theirs' (version 1)" in told["detail"]
    assert len(asked) == 1
    assert store.campaigns.page(10).items == ()


@pytest.mark.parametrize("count", [0, MAX_CAMPAIGNS_AT_ONCE + 1])
def test_lists_have_a_length(http, fields, problem, count):
    told = problem(http.post(f"{URL}/bulk", json=[fields] * count), 422)
    assert f"the list has {count} campaigns" in told["detail"]
