"""What the figures on the pages are stands beside them, and on a page of its own."""

import re

import pytest

from eigenfail.values.episode import Outcome
from eigenfail_api.dashboard.glossary_page import find_term, list_terms

BUTTON = re.compile(r'data-term="([\w-]+)"')


@pytest.fixture
def terms_on(http):
    """The terms whose definitions a page offers."""
    return lambda address: set(BUTTON.findall(http.get(address).text))


@pytest.fixture
def failing(campaign, deliver, result):
    """A campaign of ten episodes, two of which failed."""
    deliver(
        campaign,
        *(result(index) for index in range(8)),
        *(result(index, Outcome.COLLISION) for index in (8, 9)),
    )
    return campaign


def test_the_glossary_tells_every_term_with_its_unit(look):
    text = look("/glossary")
    for term in list_terms():
        assert " ".join(term.words.split()) in text
        assert not term.unit or f"{term.name} [{term.unit}]" in text


def test_every_page_leads_to_the_glossary(http):
    assert '<a href="/glossary">' in http.get("/suites").text


def test_the_figures_of_a_campaign_are_defined_where_they_stand(terms_on, failing):
    found = terms_on(f"/campaigns/{failing}") | terms_on(f"/campaigns/{failing}/measures")
    labels = (
        *("Cost per failure", "Failures", "log p", "Mean severity", "Episodes/s"),
        *("Near misses", "Unavoidable", "Planner failures", "Lead time of MinTTC"),
        *("MinTTC", "DRAC", "VaR", "CVaR", "Severity against log p", "Robustness"),
        "Share [95 %]",
    )
    assert {find_term(label).key for label in labels} <= found


def test_those_of_other_pages_are_too(terms_on, http, failing, finished):
    assert {"failure", "cost-per-failure", "log-p", "severity"} <= terms_on("/")
    assert {"robustness", "log-p", "typical-log-p", "digest"} <= terms_on(
        f"/campaigns/{failing}/episodes/8"
    )
    finished(2)
    assert {"mode", "eigenfailure", "medoid", "proof", "adjusted-rand-index"} <= terms_on(
        "/analyses/1"
    )


def test_a_definition_adds_no_words_to_the_label_that_it_is_beside(look, failing):
    assert "Failures 2 of 10" in look(f"/campaigns/{failing}")
