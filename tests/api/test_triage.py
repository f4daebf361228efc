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


@pytest.fixture
def address(made):
    return f"{URL}/analyses/{made[1]}/modes/2/triage"


def post(http, path, body, status=200):
    response = http.post(path, json=body)
    assert response.status_code == status, response.text
    return response.json()


def test_triage_is_changed_field_by_field(http, address):
    first = http.get(address).json()
    assert first == {
        "state": "new",
        "ticket": "",
        "note": "",
        "changed_ms": None,
        "changed_by": "",
    }
    told = post(http, address, {"state": "confirmed", "note": "  seen\r\n\ttwice <b>\n"})
    assert (told["state"], told["note"]) == ("confirmed", "seen\n twice <b>")
    assert told["changed_by"] == "loopback"
    told = post(http, address, {"ticket": " https://tickets.example/7?a=1#b "})
    assert (told["state"], told["note"]) == ("confirmed", "seen\n twice <b>")
    assert told["ticket"] == "https://tickets.example/7?a=1#b"
    assert http.get(address).json() == told
    told = post(http, address, {"note": "", "ticket": ""})
    assert (told["note"], told["ticket"]) == ("", "")


@pytest.mark.parametrize(
    ("body", "field"),
    [
        ({"state": "maybe"}, "state"),
        ({"note": "x" * 4_001}, "note"),
        ({"note": "a\x1b"}, "note"),
        ({"note": "\x00"}, "note"),
        ({"ticket": f"https://tickets.example/{'x' * 500}"}, "ticket"),
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
    told = problem(http.post(address, json=body), 422)
    assert field in told["field"]
    assert http.get(address).json()["changed_ms"] is None


def test_an_unknown_field_is_refused_with_the_known_ones(http, problem, address):
    told = problem(http.post(address, json={"staet": "known"}), 422)
    assert told["name"] == "staet"
    assert "state" in told["known"]


def test_modes_are_filtered_by_their_state(http, problem, made):
    modes = f"{URL}/analyses/{made[1]}/modes"
    post(http, f"{modes}/1/triage", {"state": "known"})
    for query, numbers in (("state=known", [1]), ("state=new", [2]), ("state=fixed", [])):
        found = http.get(f"{modes}?{query}").json()["items"]
        assert [mode["number"] for mode in found] == numbers, query
    problem(http.get(f"{modes}?state=maybe"), 422)


def test_the_digest_of_a_campaign_does_not_have_triage(http, made):
    campaign, analysis = made
    before = http.get(f"{URL}/campaigns/{campaign}/digest").json()
    change = {"state": "not_a_bug", "note": "as it should be"}
    post(http, f"{URL}/analyses/{analysis}/modes/1/triage", change)
    assert http.get(f"{URL}/campaigns/{campaign}/digest").json() == before
