"""Forms for triage: they work without JavaScript, and show what was written as text."""

import re
from html import escape

import pytest
from msgspec.structs import replace
from store_checks.modes import WORDS, analysed, crashed

from eigenfail.testing.examples import analysis_result
from eigenfail.values.triage import LONGEST_LABEL, LONGEST_OWNER, MOST_LABELS, TriageChange
from eigenfail_services.store.triage import episode_subject, mode_subject

HTML = {"Accept": "text/html", "Origin": "http://127.0.0.1:8440"}


@pytest.fixture
def made(store):
    campaign = crashed(store)
    result = replace(analysis_result(), words=WORDS)
    return campaign.id, analysed(store, campaign, result)


@pytest.fixture(params=["mode", "episode"])
def subject(request, made):
    campaign, analysis = made
    return {
        "mode": (f"/analyses/{analysis}/modes/2", mode_subject(analysis, 2)),
        "episode": (f"/campaigns/{campaign}/episodes/1", episode_subject(campaign, 1)),
    }[request.param]


def send(http, path, **fields):
    return http.post(path, data=fields, headers=HTML, follow_redirects=False)


def read_version(page):
    return {"changed_ms": re.search(r'name="changed_ms" value="(\d*)"', page)[1]}


def test_a_form_changes_triage_and_leads_back(http, store, subject):
    address, what = subject
    fields = {"state": "confirmed", "owner": "anna", "labels": "late, braking,", "ticket": ""}
    answer = send(http, f"{address}/triage", **fields)
    assert (answer.status_code, answer.headers["location"]) == (303, f"{address}#triage")
    told = store.triage.get(what)
    assert (told.state, told.owner, told.labels) == ("confirmed", "anna", ("braking", "late"))
    page = http.get(address, headers=HTML).text
    assert '<option value="confirmed" selected>' in page
    assert 'value="braking, late"' in page
    shown = {"state": "new", "owner": "", "labels": "", "ticket": "", **read_version(page)}
    assert send(http, f"{address}/triage", **shown).status_code == 303
    told = store.triage.get(what)
    assert (told.state, told.owner, told.labels) == ("new", "", ())


def test_the_page_of_a_failure_has_the_triage_of_its_mode(http, store, made):
    campaign, analysis = made
    index = store.analyses.get(analysis).result.episodes[0]
    (mode,) = store.analyses.find_modes(campaign, index)
    address = f"/campaigns/{campaign}/episodes/{index}"
    assert "State of the mode" not in http.get(address, headers=HTML).text
    store.triage.change(
        mode_subject(analysis, mode.number), TriageChange(state="known", owner="anna"), "ben"
    )
    assert "State of the mode: known, owner anna." in http.get(address, headers=HTML).text


def test_a_page_that_was_opened_before_another_change_overwrites_nothing(http, store, subject):
    address, what = subject
    page = http.get(address, headers=HTML).text
    bulk = TriageChange(add_labels=("night",), owner="ben")
    store.triage.change(what, bulk, "ben")
    fields = {"state": "confirmed", "owner": "", "labels": "late", "ticket": ""}
    answer = send(http, f"{address}/triage", **fields, **read_version(page))
    assert answer.status_code == 409
    assert answer.headers["content-type"].startswith("text/html")
    assert "was changed meanwhile, by ben. Open the page again" in re.sub(
        r"\s+", " ", re.sub(r"<[^>]+>", " ", answer.text)
    )
    told = store.triage.get(what)
    assert (told.state, told.owner, told.labels) == ("new", "ben", ("night",))
    seen = read_version(http.get(address, headers=HTML).text)
    assert send(http, f"{address}/triage", **fields, **seen).status_code == 303
    assert store.triage.get(what).labels == ("late",)


def test_forms_state_the_bounds(http, made):
    campaign, analysis = made
    pages = [
        f"/analyses/{analysis}",
        f"/campaigns/{campaign}/episodes",
        f"/analyses/{analysis}/modes/1",
    ]
    for page in pages:
        text = http.get(page, headers=HTML).text
        assert f'name="owner" type="text" maxlength="{LONGEST_OWNER}"' in text
        longest = MOST_LABELS * (LONGEST_LABEL + 2)
        assert f'name="labels" type="text" maxlength="{longest}"' in text


def test_tickets_and_notes_are_shown_as_text(http, subject):
    address, _ = subject
    ticket = 'https://tickets.example/7?a="><script>'
    send(http, f"{address}/triage", state="known", ticket=ticket)
    send(http, f"{address}/notes", text="<script>alert(1)</script>\nsecond line")
    page = http.get(address, headers=HTML).text
    assert 'rel="noopener noreferrer"' in page
    assert "<script>alert" not in page
    assert '"><script>' not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt;\nsecond line" in page


@pytest.mark.parametrize(
    ("form", "fields"),
    [
        ("triage", {"state": "maybe"}),
        ("triage", {"state": "known", "changed_ms": "yesterday"}),
        ("triage", {"state": "known", "ticket": "javascript:alert(1)"}),
        ("triage", {"state": "known", "labels": "x" * 41}),
        ("notes", {"text": "  "}),
        ("notes", {}),
    ],
)
def test_what_cannot_be_is_refused_on_a_page(http, store, subject, form, fields):
    address, what = subject
    answer = send(http, f"{address}/{form}", **fields)
    assert answer.status_code == 422
    assert answer.headers["content-type"].startswith("text/html")
    assert store.triage.get(what).changed_ms is None
    assert store.triage.notes(what, 1).items == ()


def test_a_form_of_another_site_is_refused(http, store, subject):
    address, what = subject
    foreign = {**HTML, "Origin": "http://elsewhere.example"}
    answer = http.post(f"{address}/triage", data={"state": "known"}, headers=foreign)
    assert answer.status_code == 403
    assert store.triage.get(what).changed_ms is None


def test_all_episodes_that_match_are_changed(http, store, made):
    campaign, _ = made
    store.triage.add_note(episode_subject(campaign, 3), "kept", "anna")
    fields = {"filter": "severity > 11", "state": "known", "owner": "", "labels": "v2"}
    answer = send(http, f"/campaigns/{campaign}/episodes/triage", **fields)
    page = http.get(answer.headers["location"], headers=HTML).text
    assert "Triage of 2 episodes was changed." in page
    assert page.count('<span class="note">known</span>') == 2
    rows = store.episodes.page(campaign, 9).items
    assert [row.labels for row in rows] == [(), (), ("v2",), ("v2",)]


def test_the_selected_modes_are_changed(http, store, made):
    _, analysis = made
    address = f"/analyses/{analysis}"
    fields = {"mode-2": "on", "mode-9": "on", "state": "known", "owner": "", "labels": "v2"}
    answer = send(http, f"{address}/modes/triage", **fields)
    place = f"{address}?changed=1#triage"
    assert (answer.status_code, answer.headers["location"]) == (303, place)
    modes = store.analyses.modes(analysis)
    assert [(mode.state, mode.labels) for mode in modes] == [("new", ()), ("known", ("v2",))]
    assert "Triage of 1 group was changed." in http.get(place, headers=HTML).text
    page = http.get(address, headers=HTML).text
    assert "was changed." not in page
    assert page.count("Triage: known") == 1
    names = [mode.name for mode in modes]
    boxes = [f'name="mode-{n}"> {n}: {escape(name)}<' for n, name in enumerate(names, start=1)]
    assert all(box in page for box in boxes)
    assert page.index('id="triage"') < page.index('id="details-title"')
    assert send(http, f"{address}/modes/triage", **{"mode-1": "on"}).headers["location"] == (
        f"{address}?changed=0#triage"
    )
    assert send(http, f"{address}/modes/triage", state="fixed").status_code == 422


def test_pages_show_triage(check_page, store, made):
    _, analysis = made
    subject = mode_subject(analysis, 2)
    store.triage.add_note(subject, "as in release 7", "anna")
    check_page("dashboard/triage/mode", f"/analyses/{analysis}/modes/2")
