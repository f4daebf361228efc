"""The risk page: a form, and the answer to its question."""

from html import unescape

import pytest

from eigenfail.files import parse_toml
from eigenfail.settings import convert
from eigenfail.values.episode import Outcome
from eigenfail_assurance.risk.page import EXAMPLE
from eigenfail_assurance.risk.question import RiskQuestion


@pytest.fixture
def counted(http, fields, deliver, result, store):
    """A campaign of Monte Carlo that is done, with 2 failures of 10."""
    made = http.post("/api/v1/campaigns", json=fields).json()["id"]
    crashes = (Outcome.COLLISION if index < 2 else Outcome.SAFE for index in range(10))
    deliver(made, *(result(index, outcome) for index, outcome in enumerate(crashes)))
    for state in ("running", "done"):
        if store.campaigns.get(made).state != state:
            store.campaigns.move(made, state)
    return made


@pytest.fixture
def ask(http, text_of):
    """The text of the answer to a question, which must have the status."""

    def send(text, status=200):
        answer = http.post("/risk", data={"question": text})
        assert answer.status_code == status
        return text_of(answer)

    return send


def test_the_form_begins_empty_beside_an_example(check_page, http):
    check_page("dashboard/risk/empty", "/risk")
    shown = http.get("/risk").text
    typed = shown.partition("<textarea")[2].partition("</textarea>")[0].partition(">")[2]
    assert typed.strip() == ""
    assert 'name = "Motorway"' in unescape(shown)


def test_the_example_is_a_question():
    assert convert(parse_toml(EXAMPLE, "question", ""), RiskQuestion, "question").severity


def test_the_answer_has_verdict_tables_and_limits(ask, counted):
    text = ask(EXAMPLE.replace("[1]", f"[{counted}]"))
    assert "Motorway: not met. Failures are at least" in text
    for title in ("Total", "Scenarios", "Severity", "Next 10,000 episodes", "Limits"):
        assert title in text
    assert "per 10⁶ km" in text
    # What was typed stays, to be changed.
    assert 'as TOML name = "Motorway"' in text


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[1]", "[99]", "Campaign 99 does not exist."),
        ("encounters", "encounter", "encounters"),
        ("[target]", "[target", "is not TOML"),
        ("[1]", "[1, 1]", "is named twice"),
        ("[1]", "[" * 3_000 + "1" + "]" * 3_000, "is not TOML"),
        ("340", "3" * 5_000, "is not TOML"),
        ("340", "-1", "-1 is not an integer from 0 to 1e+12."),
    ],
)
def test_what_cannot_be_answered_is_told_beside_the_question(ask, counted, old, new, said):
    assert counted == 1
    text = ask(EXAMPLE.replace(old, new), 422)
    assert said in text
    assert 'as TOML name = "Motorway"' in text
    assert "not met" not in text


def test_an_empty_form_is_refused(http):
    assert http.post("/risk").status_code == 422
    assert http.post("/risk", content=b"\xff").status_code == 400
    assert http.post("/risk", data={"question": "", "other": ""}).status_code == 400


def test_other_pages_have_a_link_to_it(http):
    assert '<a href="/risk">Risk</a>' in http.get("/workers").text
    assert '<a href="/risk" aria-current="page">Risk</a>' in http.get("/risk").text
