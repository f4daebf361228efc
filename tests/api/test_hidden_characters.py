"""Characters that nobody sees, and that change how the text around them is read: refused."""

import json

import pytest
from store_checks.modes import analysed, crashed

from eigenfail.errors import InvalidValue, find_hidden, is_unsafe, read_text
from eigenfail.testing.examples import analysis_result
from eigenfail.values.access import KeyRequest, Scope
from eigenfail_services.access import make_key

URL = "/api/v1"
HIDDEN = "gnp\u202eexe"
"""Reads `gnpexe.exe` backwards from the override on."""

GATE = {
    "gate": {"suite": "nightly", "version": HIDDEN, "run": "nightly @ v2", "baseline": "v1"},
    "open": True,
    "counts": {},
    "members": [],
}
CAMPAIGN = {"method": "monte_carlo", "episodes": 10, "planner": "idm", "simulator": "point_mass"}
FORMULA = {"kind": "formula", "name": HIDDEN, "formula": "always (speed_mps < 100)"}


@pytest.fixture
def paths(store):
    campaign = crashed(store)
    analysis = analysed(store, campaign, analysis_result())
    return {"mode": f"{URL}/analyses/{analysis}/modes/1", "campaigns": f"{URL}/campaigns"}


BODIES = [
    ("POST", f"{URL}/campaigns", {**CAMPAIGN, "name": HIDDEN}, "name"),
    ("POST", f"{URL}/campaigns", {**CAMPAIGN, "name": "a", "project": HIDDEN}, "project"),
    ("POST", f"{URL}/campaigns", {**CAMPAIGN, "name": "a", "tags": [HIDDEN]}, "tags"),
    ("POST", f"{URL}/campaigns", {**CAMPAIGN, "name": "a", "planner_settings": {HIDDEN: 1}}, ""),
    ("POST", f"{URL}/campaigns", {**CAMPAIGN, "name": "a", "requirements": [FORMULA]}, "name"),
    ("POST", f"{URL}/campaigns/check", {**CAMPAIGN, "name": HIDDEN}, "name"),
    ("POST", f"{URL}/suites", {"name": HIDDEN, "base": CAMPAIGN, "sweep": {"seed": [1]}}, "name"),
    ("POST", f"{URL}/keys", {"name": HIDDEN, "scope": "admin"}, "name"),
    ("POST", f"{URL}/gates", GATE, "gate.version"),
    ("PUT", "{mode}/name", {"name": HIDDEN}, "name"),
    ("POST", "{mode}/triage", {"ticket": f"https://tickets.example/{HIDDEN}"}, "ticket"),
    ("POST", "{mode}/triage", {"note": HIDDEN}, "note"),
]


@pytest.mark.parametrize("sent", BODIES)
def test_body_with_a_hidden_character_is_refused(http, paths, sent):
    method, path, body, field = sent
    for data in (json.dumps(body), json.dumps(body, ensure_ascii=False).encode()):
        response = http.request(
            method, path.format(**paths), content=data, headers={"content-type": "application/json"}
        )
        if path.endswith("/check") and response.status_code == 200:
            told = response.json()["problems"][0]
        else:
            assert response.status_code == 422, response.text
            told = response.json()
        assert field in told["field"]
        assert "\u202e" not in response.text


@pytest.mark.parametrize("field", ["note", "ticket"])
def test_form_with_a_hidden_character_is_refused(http, paths, field):
    page = paths["mode"].removeprefix(URL)
    response = http.post(f"{page}/triage", data={field: HIDDEN, "state": "new"})
    assert response.status_code == 422


@pytest.mark.parametrize("name", [HIDDEN, "a\u200bb", "a\u2066b", "a\x1b[31mb", "a\ufeff"])
def test_key_of_the_command_line_with_a_hidden_character_is_refused(store, name):
    with pytest.raises(InvalidValue, match="invisible"):
        make_key(store, KeyRequest(name, Scope.ADMIN))


def test_bidirectional_and_invisible_characters_are_hidden():
    controls = [*range(0x202A, 0x202F), *range(0x2066, 0x206A), 0x200E, 0x200F, 0x061C]
    for code in (*controls, 0x200B, 0x2060, 0xFEFF, 0x00AD):
        assert find_hidden(f"a{chr(code)}b") == f"U+{code:04X}"
        assert is_unsafe(chr(code))


@pytest.mark.parametrize("text", ["👩‍🔧", "می‌خواهم", "Straße 東京", "naïve"])
def test_joiners_of_scripts_and_emoji_are_kept(http, text):
    assert find_hidden(text) == ""
    body = {**CAMPAIGN, "name": text}
    assert http.post(f"{URL}/campaigns", json=body).json()["spec"]["name"] == text


def test_error_texts_show_hidden_characters_as_escapes():
    assert read_text(f"No module {HIDDEN}") == "No module gnp\\u202eexe"
    assert "\\u202e" in str(InvalidValue("name", f"'{HIDDEN}' is unknown."))
