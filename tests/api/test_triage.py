"""Triage over HTTP: changed, found again, refused with the field."""

import json

import pytest
from store_checks.modes import analysed, crashed

from eigenfail.testing.examples import analysis_result

URL = "/api/v1"


@pytest.fixture
def made(store):
    """A campaign of four failures and its analysis with two modes."""
    campaign = crashed(store)
    return campaign.id, analysed(store, campaign, analysis_result())


@pytest.fixture(params=["mode", "episode"])
def address(request, made):
    campaign, analysis = made
    places = {
        "mode": f"{URL}/analyses/{analysis}/modes/2",
        "episode": f"{URL}/campaigns/{campaign}/episodes/1",
    }
    return places[request.param]


def post(http, path, body, status=200):
    response = http.post(path, json=body)
    assert response.status_code == status, response.text
    return response.json()


def test_triage_is_changed_field_by_field(http, address):
    first = http.get(f"{address}/triage").json()
    assert (first["state"], first["owner"], first["labels"], first["changed_ms"]) == (
        *("new", "", []),
        None,
    )
    told = post(
        http,
        f"{address}/triage",
        {"state": "confirmed", "owner": "  anna  b ", "labels": ["late", "braking"]},
    )
    assert (told["owner"], told["labels"]) == ("anna b", ["braking", "late"])
    assert told["changed_by"] == "loopback"
    told = post(
        http,
        f"{address}/triage",
        {"ticket": "https://tickets.example/7?a=1#b", "remove_labels": ["late"]},
    )
    assert (told["state"], told["owner"], told["labels"]) == ("confirmed", "anna b", ["braking"])
    assert http.get(f"{address}/triage").json() == told
    assert post(http, f"{address}/triage", {"owner": "", "ticket": ""})["owner"] == ""


@pytest.mark.parametrize(
    ("body", "field"),
    [
        ({"state": "maybe"}, "state"),
        ({"owner": "x" * 81}, "owner"),
        ({"owner": "a\x1b"}, "owner"),
        ({"labels": ["a,b"]}, "labels"),
        ({"labels": [" "]}, "labels"),
        ({"add_labels": ["x" * 41]}, "add_labels"),
        ({"labels": [str(n) for n in range(21)]}, "labels"),
        ({"ticket": "javascript:alert(1)"}, "ticket"),
        ({"ticket": "ftp://tickets.example/7"}, "ticket"),
        ({"ticket": "https://"}, "ticket"),
        ({"ticket": "https://a b"}, "ticket"),
        ({"ticket": "http://[::1"}, "ticket"),
        ({"ticket": "//tickets.example/7"}, "ticket"),
    ],
    ids=json.dumps,
)
def test_what_cannot_be_is_refused_with_its_field(http, problem, address, body, field):
    told = problem(http.post(f"{address}/triage", json=body), 422)
    assert field in told["field"]
    assert http.get(f"{address}/triage").json()["changed_ms"] is None


def test_an_unknown_field_is_refused_with_the_known_ones(http, problem, address):
    told = problem(http.post(f"{address}/triage", json={"staet": "known"}), 422)
    assert told["name"] == "staet"
    assert "state" in told["known"]


def test_notes_are_added_and_listed(http, problem, address):
    for text in ("first", "  second\r\nline <b>\n"):
        post(http, f"{address}/notes", {"text": text})
    listed = http.get(f"{address}/notes?limit=1").json()
    assert [note["text"] for note in listed["items"]] == ["second\nline <b>"]
    assert listed["items"][0]["author"] == "loopback"
    older = http.get(f"{address}/notes?before={listed['next']}").json()
    assert [note["text"] for note in older["items"]] == ["first"]
    for text in ("", " \n ", "\x00", "x" * 4001):
        problem(http.post(f"{address}/notes", json={"text": text}), 422)


def test_lists_have_triage_and_are_filtered_by_it(http, made):
    campaign, analysis = made
    change = {"state": "known", "owner": "anna", "add_labels": ["late"]}
    post(http, f"{URL}/campaigns/{campaign}/episodes/2/triage", change)
    post(http, f"{URL}/analyses/{analysis}/modes/1/triage", change)
    episodes = f"{URL}/campaigns/{campaign}/episodes"
    (row,) = http.get(f"{episodes}?filter=state = known and label = late").json()["items"]
    assert (row["index"], row["owner"], row["labels"]) == (2, "anna", ["late"])
    fields = http.get(f"{episodes}?fields=index,state,owner,label&limit=3").json()["items"]
    assert fields[0] == {"index": 0, "state": "new", "owner": "", "label": None}
    assert fields[2] == {"index": 2, "state": "known", "owner": "anna", "label": "late"}
    modes = f"{URL}/analyses/{analysis}/modes"
    for query, numbers in (
        ("state=known", [1]),
        ("state=new", [2]),
        ("owner=", [2]),
        ("owner=anna&label=late", [1]),
        ("label=other", []),
    ):
        found = http.get(f"{modes}?{query}").json()["items"]
        assert [mode["number"] for mode in found] == numbers, query


def test_many_are_changed_at_once(http, problem, made):
    campaign, analysis = made
    episodes = f"{URL}/campaigns/{campaign}/episodes"
    asked = {"filter": "severity > 11", "change": {"state": "fixed", "add_labels": ["v2"]}}
    assert post(http, f"{episodes}/triage", asked) == {"matched": 2, "changed": 2}
    assert post(http, f"{episodes}/triage", asked) == {"matched": 2, "changed": 0}
    assert (
        "filter"
        in problem(http.post(f"{episodes}/triage", json={**asked, "filter": "sevrity > 1"}), 422)[
            "field"
        ]
    )
    modes = f"{URL}/analyses/{analysis}/modes/triage"
    told = post(http, modes, {"modes": [2, 1], "change": {"owner": "anna"}})
    assert told == {"matched": 2, "changed": 2}
    problem(http.post(modes, json={"modes": [1, 3], "change": {"owner": "ben"}}), 404)
    problem(http.post(modes, json={"modes": [], "change": {}}), 422)
    owners = http.get(f"{URL}/analyses/{analysis}/modes").json()["items"]
    assert [mode["owner"] for mode in owners] == ["anna", "anna"]


def test_the_digest_of_a_campaign_does_not_have_triage(http, made):
    campaign, _ = made
    before = http.get(f"{URL}/campaigns/{campaign}/digest").json()
    asked = {"filter": "", "change": {"state": "not_a_bug", "owner": "anna"}}
    assert post(http, f"{URL}/campaigns/{campaign}/episodes/triage", asked)["changed"] == 4
    assert http.get(f"{URL}/campaigns/{campaign}/digest").json() == before


def test_a_change_of_too_many_is_refused_as_a_whole(http, problem, made, monkeypatch):
    monkeypatch.setattr("eigenfail_services.store.triage.MOST_TRIAGED", 3)
    campaign, _ = made
    episodes = f"{URL}/campaigns/{campaign}/episodes"
    asked = {"filter": "", "change": {"state": "known"}}
    told = problem(http.post(f"{episodes}/triage", json=asked), 422)
    assert (told["field"], "more than 3 episodes" in told["detail"]) == ("filter", True)
    assert http.get(f"{episodes}?filter=state = known").json()["items"] == []
    assert post(http, f"{episodes}/triage", {**asked, "filter": "index > 0"})["changed"] == 3
