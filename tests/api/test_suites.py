"""Suites over HTTP: lists, tables, and campaigns of one."""

import pytest


@pytest.fixture
def make(http, fields):
    def create(*names):
        for name in names:
            made = http.post("/api/v1/campaigns", json={**fields, "name": name})
            assert made.status_code == 201, made.text

    return create


def test_suites_come_in_pages_the_newest_first(http, make):
    make("a: 1", "b: 1", "alone", "a: 2")
    first = http.get("/api/v1/suites?limit=1").json()
    assert [suite["name"] for suite in first["items"]] == ["a"]
    assert first["items"][0]["states"] == {"queued": 2}
    assert first["next"] == 4
    last = http.get("/api/v1/suites?limit=1&before=4").json()
    assert ([suite["name"] for suite in last["items"]], last["next"]) == (["b"], None)


def test_a_suite_is_one_table(http, make, deliver, result):
    make("a: 1", "a: 2")
    deliver(2, result(0))
    table = http.get("/api/v1/suites/a").json()
    assert (table["suite"], table["columns"]) == ("a", [])
    assert [row["member"] for row in table["members"]] == ["1", "2"]
    assert table["members"][1]["summary"]["failure_rate"]["n"] == 1


def test_campaigns_of_a_suite_alone(http, make):
    make("a: 1", "b: 1", "a: 2")
    found = http.get("/api/v1/campaigns?suite=a&limit=1").json()
    assert ([each["id"] for each in found["items"]], found["next"]) == ([3], 3)
    assert http.get("/api/v1/campaigns?suite=none").json()["items"] == []


def test_a_name_may_hold_a_slash(http, make):
    make("feature/x @ v1: one")
    for address in ("feature/x @ v1", "feature%2Fx%20%40%20v1"):
        assert http.get(f"/api/v1/suites/{address}").json()["suite"] == "feature/x @ v1"


@pytest.mark.parametrize("name", ["nobody", "", "alone"])
def test_a_suite_that_there_is_not_is_a_problem(http, make, problem, name):
    make("alone")
    told = problem(http.get(f"/api/v1/suites/{name}"), 404)
    if name:
        assert "eigenfail suite list" in told["remedy"]


@pytest.mark.parametrize("ids", ["", "0", "1,", "a", f"1{',1' * 10_000}"])
def test_ids_that_are_none_are_refused(http, problem, ids):
    problem(http.get(f"/api/v1/seeds?campaigns={ids}"), 422)


def test_an_id_beyond_all_integers_is_no_campaign(http, problem):
    problem(http.get(f"/api/v1/seeds?campaigns={'9' * 19}"), 404)
