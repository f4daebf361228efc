"""Suites created by one request: all campaigns or none, and none twice."""

import pytest

from eigenfail.client import Client
from eigenfail.suites import Suite, SuiteFile
from eigenfail.values.campaign import CampaignState
from eigenfail_api import concurrency
from eigenfail_services.campaigns.suites import refuse_large_suite

URL = "/api/v1/suites"


@pytest.fixture
def base(fields):
    return {name: value for name, value in fields.items() if name != "name"}


@pytest.fixture
def grid(base):
    return {"name": "a", "base": base, "grid": {"seed": [1, 2], "settings": {"round_size": [5, 7]}}}


def seeds(store):
    return [each.spec.seed for each in reversed(store.campaigns.page(50).items)]


def test_every_combination_is_a_campaign_and_the_answer_is_the_table(http, grid):
    made = http.post(URL, json=grid)
    assert made.status_code == 201, made.text
    assert made.headers["location"] == f"{URL}/a"
    assert made.json() == http.get(made.headers["location"]).json()
    assert [row["member"] for row in made.json()["members"]] == [
        "seed=1, round_size=5",
        "seed=1, round_size=7",
        "seed=2, round_size=5",
        "seed=2, round_size=7",
    ]


def test_a_repeated_request_creates_only_what_is_missing(http, grid, store):
    first = http.post(URL, json=grid).json()
    assert http.post(URL, json=grid).json() == first
    more = {**grid, "grid": {**grid["grid"], "seed": [1, 2, 3]}}
    assert len(http.post(URL, json=more).json()["members"]) == 6
    assert seeds(store) == [1, 1, 2, 2, 3, 3]


def test_a_client_finds_the_campaigns_of_a_request_and_the_other_way_round(http, grid, store):
    suite = Suite.of(**grid)
    with Client(transport=http._transport) as client:
        client.suites.create(suite)
        http.post(URL, json=grid)
        assert len(client.suites.find(suite)) == 4
    assert seeds(store) == [1, 1, 2, 2]


def test_a_wrong_member_leaves_no_campaign(http, grid, store, problem):
    grid["grid"]["settings"]["round_size"] = [5, 0]
    told = problem(http.post(URL, json=grid), 422)
    assert told["field"] == "member 'seed=1, round_size=0'.settings.round_size"
    assert seeds(store) == []


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"name": None}, "name"),
        ({"name": ""}, "name"),
        ({"name": "a: b"}, "name"),
        ({"grid": {"seed": []}}, "grid.seed"),
        ({"grid": {"seed": [1, 1]}}, ""),
        ({"grid": {"seed": [*range(32)], "episodes": [*range(1, 33)]}}, ""),
        ({"grid": {}}, ""),
        ({"base": 3}, "base"),
        ({"gird": {}}, ""),
        ({"grid": {"sede": [1]}}, "member 'sede=1'"),
        ({"grid": {"episodes": ["many"]}}, "member 'episodes=many'.episodes"),
    ],
    ids=str,
)
def test_what_cannot_be_a_suite_is_refused_by_its_field(*, http, grid, problem, changes, field):
    told = problem(http.post(URL, json={**grid, **changes}), 422)
    assert told.get("field", "") == field


@pytest.mark.parametrize(
    ("way", "axes"),
    [
        ("grid", {"seed": [*range(30)], "episodes": [*range(1, 31)]}),
        ("sweep", {"seed": [*range(900)]}),
        ("campaigns", [{"seed": seed} for seed in range(900)]),
        ("grid", {"seed": [*range(500)], "scenario_parameters": {"x": ["y" * 50_000, 2]}}),
    ],
    ids=["grid", "sweep", "campaigns", "large value"],
)
def test_members_that_are_too_large_together_are_refused(*, http, base, problem, way, axes):
    base["settings"] = {"note": "x" * 30_000}
    told = problem(http.post(URL, json={"name": "a", "base": base, way: axes}), 422)
    assert "MB, more than 20 MB" in told["detail"]


def test_a_large_list_of_small_members_is_no_large_suite(base):
    campaigns = [{"seed": seed, "settings": {"note": "x" * 900}} for seed in range(1000)]
    refuse_large_suite(SuiteFile(base=base, campaigns=campaigns))


def test_members_that_build_upon_others_follow_with_a_later_request(http, base, store):
    campaigns = [{"name": "first"}, {"name": "again", "settings": {"campaign": "first"}}]
    campaigns[1] |= {"method": "replay"}
    asked = {"name": "a", "base": base, "campaigns": campaigns}
    assert [row["member"] for row in http.post(URL, json=asked).json()["members"]] == ["first"]
    campaigns[1]["method"] = "no_method"
    told = http.post(URL, json=asked)
    assert (told.status_code, told.json()["field"]) == (422, "member 'again'.method")
    for state in (CampaignState.RUNNING, CampaignState.DONE):
        store.campaigns.move(1, state)
    campaigns[1]["method"] = "replay"
    assert [row["member"] for row in http.post(URL, json=asked).json()["members"]] == [
        "first",
        "again",
    ]
    assert store.campaigns.get(2).spec.settings["campaign"] == 1


def test_a_crowd_of_suites_is_refused(http, grid, monkeypatch):
    monkeypatch.setattr(concurrency, "MOST_WAITING", -concurrency.MOST_RUNNING)
    assert http.post(URL, json=grid).status_code == 503
    monkeypatch.undo()
    assert http.post(URL, json=grid).is_success
