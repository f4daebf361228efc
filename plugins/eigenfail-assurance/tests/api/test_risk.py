"""The risk of a planner, over HTTP."""

import json

import pytest

from eigenfail_assurance.risk.assessment import RiskAssessment, RiskVerdict

URL = "/api/v1/risk"
QUESTION = {
    "name": "motorway",
    "target": {"per_hour": 1e-3},
    "exposure": {"hours": 100.0, "kilometres": 8_000.0},
    "scenarios": [{"name": "cut-in", "encounters": 30, "campaigns": [1]}],
}


def test_a_question_has_an_answer(http, fields, read):
    http.post("/api/v1/campaigns", json=fields)
    found = read(http.post(URL, json=QUESTION), RiskAssessment)
    assert found.verdict is RiskVerdict.UNDECIDED
    assert found.scenarios[0].encounters_per_hour.value == pytest.approx(0.3)
    assert found.per_million_km is not None
    assert "is queued" in found.scenarios[0].problem


def test_the_same_question_has_the_same_answer(http, fields):
    http.post("/api/v1/campaigns", json=fields)
    assert http.post(URL, json=QUESTION).content == http.post(URL, json=QUESTION).content


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"target": {}}, "target"),
        ({"target": {"per_hour": 0}}, "target.per_hour"),
        ({"exposure": {"hours": 1e13}}, "exposure.hours"),
        ({"scenarios": []}, "scenarios"),
        ({"scenarios": [{"name": "a", "encounters": -1}]}, "scenarios[0].encounters"),
        ({"severity": [2.0, 1.0]}, "severity"),
        ({"episodes": 0}, "episodes"),
    ],
)
def test_what_is_wrong_is_named(http, problem, changes, field):
    assert problem(http.post(URL, json={**QUESTION, **changes}), 422)["field"] == field


def test_a_campaign_that_is_not_there_is_told(http, problem):
    assert "Campaign 1 does not exist" in problem(http.post(URL, json=QUESTION), 404)["detail"]


def test_an_unknown_field_is_told_with_what_it_may_have_been(http, problem):
    told = problem(http.post(URL, json={**QUESTION, "severty": [1.0]}), 422)
    assert "severty" in told["detail"]
    assert "severity" in f"{told['detail']} {told.get('remedy', '')}"


@pytest.mark.parametrize("as_ascii", [True, False])
def test_a_hidden_character_is_refused(http, problem, as_ascii):
    hidden = "gnp\u202eexe"
    content = json.dumps({**QUESTION, "name": hidden}, ensure_ascii=as_ascii).encode()
    told = problem(
        http.post(URL, content=content, headers={"content-type": "application/json"}), 422
    )
    assert told["field"] == "name"
    assert "\u202e" not in json.dumps(told, ensure_ascii=False)
