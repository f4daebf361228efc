"""The form for triage: it works without JavaScript, and shows what was written as text."""

import re

import pytest
from msgspec.structs import replace
from store_checks.modes import WORDS, analysed, crashed

from eigenfail.testing.examples import analysis_result
from eigenfail.values.triage import LONGEST_NOTE, LONGEST_TICKET, TriageChange

HTML = {"Accept": "text/html", "Origin": "http://127.0.0.1:8440"}


@pytest.fixture
def made(store):
    campaign = crashed(store)
    result = replace(analysis_result(), words=WORDS)
    return campaign.id, analysed(store, campaign, result)


@pytest.fixture
def address(made):
    return f"/analyses/{made[1]}/modes/2"


@pytest.fixture
def seen(store, made):
    """Reads the triage of the mode."""
    return lambda: store.analyses.get_triage(made[1], 2)


def send(http, path, **fields):
    return http.post(path, data=fields, headers=HTML, follow_redirects=False)


def read_version(page):
    return {"changed_ms": re.search(r'name="changed_ms" value="(\d*)"', page)[1]}


def test_a_form_changes_triage_and_leads_back(http, address, seen):
    fields = {"state": "confirmed", "ticket": "", "note": "brakes late"}
    answer = send(http, f"{address}/triage", **fields)
    assert (answer.status_code, answer.headers["location"]) == (303, f"{address}#triage")
    assert (seen().state, seen().note) == ("confirmed", "brakes late")
    page = http.get(address, headers=HTML).text
    assert '<option value="confirmed" selected>' in page
    assert "brakes late</textarea>" in page
    shown = {"state": "new", "ticket": "", "note": "", **read_version(page)}
    assert send(http, f"{address}/triage", **shown).status_code == 303
    assert (seen().state, seen().note) == ("new", "")


def test_other_pages_show_the_state_of_a_mode(http, store, made):
    campaign, analysis = made
    index = store.analyses.get(analysis).result.episodes[0]
    (mode,) = store.analyses.find_modes(campaign, index)
    pages = f"/campaigns/{campaign}/episodes/{index}", f"/analyses/{analysis}"
    told = ("State of the mode: known.", "Triage: known")
    for page, words in zip(pages, told, strict=True):
        assert words not in http.get(page, headers=HTML).text
    store.analyses.change_triage(analysis, mode.number, TriageChange(state="known"), "ben")
    for page, words in zip(pages, told, strict=True):
        assert http.get(page, headers=HTML).text.count(words) == 1


def test_a_page_that_was_opened_before_another_change_overwrites_nothing(
    http, store, made, address, seen
):
    page = http.get(address, headers=HTML).text
    store.analyses.change_triage(made[1], 2, TriageChange(note="of ben"), "ben")
    fields = {"state": "confirmed", "ticket": "", "note": "late"}
    answer = send(http, f"{address}/triage", **fields, **read_version(page))
    assert answer.status_code == 409
    assert answer.headers["content-type"].startswith("text/html")
    assert "was changed meanwhile, by ben. Open the page again" in re.sub(
        r"\s+", " ", re.sub(r"<[^>]+>", " ", answer.text)
    )
    assert (seen().state, seen().note) == ("new", "of ben")
    version = read_version(http.get(address, headers=HTML).text)
    assert send(http, f"{address}/triage", **fields, **version).status_code == 303
    assert seen().note == "late"


def test_the_form_states_the_bounds(http, address):
    text = http.get(address, headers=HTML).text
    assert f'name="ticket" type="url" maxlength="{LONGEST_TICKET}"' in text
    assert f'name="note" rows="3" maxlength="{LONGEST_NOTE}"' in text


def test_ticket_and_note_are_shown_as_text(http, address):
    ticket = 'https://tickets.example/7?a="><script>'
    note = "</textarea><script>alert(1)</script>\nsecond line"
    send(http, f"{address}/triage", state="known", ticket=ticket, note=note)
    page = http.get(address, headers=HTML).text
    assert 'rel="noopener noreferrer"' in page
    assert "<script>alert" not in page
    assert '"><script>' not in page
    assert "&lt;/textarea&gt;&lt;script&gt;alert(1)&lt;/script&gt;\nsecond line" in page


@pytest.mark.parametrize(
    "fields",
    [
        {"state": "maybe"},
        {"state": "known", "changed_ms": "yesterday"},
        {"state": "known", "ticket": "javascript:alert(1)"},
        {"state": "known", "note": "x" * 4_001},
    ],
)
def test_what_cannot_be_is_refused_on_a_page(http, address, seen, fields):
    answer = send(http, f"{address}/triage", **fields)
    assert answer.status_code == 422
    assert answer.headers["content-type"].startswith("text/html")
    assert seen().changed_ms is None


def test_a_form_of_another_site_is_refused(http, address, seen):
    foreign = {**HTML, "Origin": "http://elsewhere.example"}
    answer = http.post(f"{address}/triage", data={"state": "known"}, headers=foreign)
    assert answer.status_code == 403
    assert seen().changed_ms is None


def test_pages_show_triage(check_page, store, made, address):
    store.analyses.change_triage(made[1], 2, TriageChange(note="as in release 7"), "anna")
    check_page("dashboard/triage/mode", address)
