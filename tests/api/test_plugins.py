"""What campaigns can name, with schemas that are true."""

from importlib.metadata import EntryPoint

import jsonschema
import pytest

from eigenfail import plugins
from eigenfail.functions import ALLOWED_VARIABLE

EXPECTED = {
    "methods": {"monte_carlo", "ast", "difs", "cem", "replay", "subset"},
    "planners": {"idm", "rulebook"},
    "scenarios": {"cut_in", "highway_drive", "lead_brake", "merge_in"},
    "simulators": {"function", "highway", "point_mass"},
}


@pytest.mark.parametrize("kind", EXPECTED)
def test_all_that_is_registered_is_listed(http, kind):
    items = http.get(f"/api/v1/{kind}").json()["items"]
    assert {item["name"] for item in items} >= EXPECTED[kind]
    assert not [item for item in items if item["problem"]]


@pytest.mark.parametrize("kind", ["methods", "planners", "scenarios"])
def test_schemas_accept_defaults_and_refuse_strangers(http, kind):
    items = {item["name"]: item for item in http.get(f"/api/v1/{kind}").json()["items"]}
    for name in EXPECTED[kind]:
        schema = items[name]["settings"]
        jsonschema.Draft202012Validator.check_schema(schema)
        jsonschema.validate({}, schema)
        assert items[name]["summary"]


def test_the_schema_of_a_scenario_carries_its_bounds(http):
    items = {item["name"]: item for item in http.get("/api/v1/scenarios").json()["items"]}
    cut_in = items["cut_in"]
    distance = cut_in["settings"]["$defs"]["CutInParameters"]["properties"]["distance_m"]
    assert distance["minimum"] < distance["default"] < distance["maximum"]


def test_a_plugin_that_cannot_be_loaded_says_why_and_hides_no_other(http, monkeypatch):
    broken = EntryPoint("broken", "no_such_module:Planner", plugins.PLANNERS)
    known = plugins.list_entry_points(plugins.PLANNERS)
    monkeypatch.setitem(known, "broken", broken)
    items = {item["name"]: item for item in http.get("/api/v1/planners").json()["items"]}
    assert "no_such_module" in items["broken"]["problem"]
    assert not items["idm"]["problem"]


def test_a_request_cannot_name_a_module_that_is_not_listed(http, fields, monkeypatch):
    on = {"simulator": "function", "scenario": "function", "scenario_parameters": {"steps": 5}}
    asked = {"listed:robustness": 201, "unlisted:robustness": 422}
    monkeypatch.setenv(ALLOWED_VARIABLE, "listed")
    for place, status in asked.items():
        answer = http.post("/api/v1/campaigns", json={**fields, **on, "planner": place})
        assert answer.status_code == status, answer.text
    assert ALLOWED_VARIABLE in answer.json()["remedy"]
