"""Saved views over HTTP: saved, listed, changed, deleted, and refused with the field."""

import json

import pytest

from eigenfail.views import LONGEST_NAME

URL = "/api/v1/views"
HARD = {
    "name": "hard and new",
    "page": "episodes",
    "query": {"filter": "severity > 80 and state = new", "sort": "-severity"},
}


def test_a_view_is_saved_changed_and_deleted(http, problem):
    made = http.post(URL, json={**HARD, "name": "  hard \n and new "})
    assert made.status_code == 201
    told = made.json()
    assert (told["name"], told["query"], told["author"]) == (
        HARD["name"],
        HARD["query"],
        "loopback",
    )
    address = made.headers["Location"]
    assert http.get(address).json() == told
    changed = http.put(address, json={"name": "open", "page": "campaigns", "query": {"sort": " "}})
    assert (changed.json()["name"], changed.json()["query"]) == ("open", {})
    for query, count in (("page=campaigns", 1), ("page=episodes", 0), ("name=open", 1)):
        assert len(http.get(f"{URL}?{query}").json()["items"]) == count
    unowned = {"name": "u", "page": "failures", "query": {"owner": " ", "planner": ""}}
    assert http.put(address, json=unowned).json()["query"] == {"owner": ""}
    assert http.delete(address).status_code == 200
    problem(http.get(address), 404)
    problem(http.put(address, json=HARD), 404)
    problem(http.delete(address), 404)


def test_a_renaming_keeps_a_filter_that_was_changed_in_between(http, problem):
    address = http.post(URL, json=HARD).headers["Location"]
    http.put(address, json={**HARD, "query": {"sort": "severity"}})
    told = http.put(f"{address}/name", json={"name": "  harder "}).json()
    assert (told["name"], told["query"]) == ("harder", {"sort": "severity"})
    assert http.get(address).json() == told
    assert problem(http.put(f"{address}/name", json={"name": " "}), 422)["field"] == "name"
    problem(http.put(f"{URL}/999/name", json={"name": "x"}), 404)


def test_a_name_is_given_once(http, problem):
    assert http.post(URL, json=HARD).status_code == 201
    told = problem(http.post(URL, json={"name": HARD["name"], "page": "campaigns"}), 409)
    assert HARD["name"] in told["detail"]


@pytest.mark.parametrize(
    ("page", "query", "field"),
    [
        ("episodes", {"filter": "severity >"}, "filter, character 11"),
        ("episodes", {"filter": "hardness > 3"}, "filter, character 1"),
        ("episodes", {"sort": "hardness"}, "sort"),
        ("episodes", {"fields": "index,hardness"}, "fields"),
        ("episodes", {"state": "new"}, "query"),
        ("episodes", {"filter": "x" * 2_001}, "query[...]"),
        ("campaigns", {"state": "new"}, "query.state"),
        ("campaigns", {"archived": "yes"}, "query.archived"),
        ("campaigns", {"sort": "severity"}, "sort"),
        ("campaigns", {"search": "a\x07b"}, "query"),
        ("campaigns", {"filter": "severity > 1"}, "query"),
        ("failures", {"state": "done"}, "query.state"),
        ("failures", {"sort": "steps"}, "sort"),
    ],
    ids=json.dumps,
)
def test_what_a_list_cannot_show_is_refused_with_its_field(http, problem, page, query, field):
    told = problem(http.post(URL, json={"name": "x", "page": page, "query": query}), 422)
    assert told["field"] == field
    assert http.get(URL).json()["items"] == []


@pytest.mark.parametrize("name", ["", "  ", "x" * (LONGEST_NAME + 1), "a\x1bb"])
def test_names_are_short_and_can_be_printed(http, problem, name):
    assert problem(http.post(URL, json={**HARD, "name": name}), 422)["field"] == "name"


def test_other_fields_and_lists_are_refused(http, problem):
    assert problem(http.post(URL, json={**HARD, "owner": "anna"}), 422)["name"] == "owner"
    assert problem(http.post(URL, json={**HARD, "page": "modes"}), 422)["field"] == "page"


def test_no_view_enters_a_digest(http, campaign, deliver, result):
    deliver(campaign, result(0))
    address = f"/api/v1/campaigns/{campaign}/digest"
    before = http.get(address).json()
    http.post(URL, json=HARD)
    assert http.get(address).json() == before
