"""The words for the figures: one for each label, and all of those that the documents promise."""

import re
from pathlib import Path

import pytest

from eigenfail_api.dashboard.glossary_page import find_term, list_terms

CONCEPTS = Path(__file__).parents[3] / "docs" / "concepts.md"
NO_FIGURES = {"gate", "report", "minimal failure"}


def test_keys_and_labels_are_of_one_term_each():
    keys = [term.key for term in list_terms()]
    labels = [label for term in list_terms() for label in term.labels]
    assert len(set(keys)) == len(keys)
    assert len(set(labels)) == len(labels)


@pytest.mark.parametrize("term", list_terms(), ids=lambda term: term.key)
def test_a_definition_is_short_and_can_be_linked_to(term):
    assert re.fullmatch(r"[a-z0-9-]+", term.key)
    assert term.words.endswith(".")
    assert len(term.words) <= 300


@pytest.mark.parametrize(
    ("label", "key"),
    [
        ("VaR 95 % [m²/s²]", "var"),
        ("MinTTC below 1.5 s", "ttc"),
        ("DRAC, largest", "drac"),
        ("Severity against log p, ρ", "severity-against-log-p"),
        ("95 % interval", "interval"),
        ("USD per failure, 95 % interval", "cost-per-failure"),
        ("Spent [USD]", "cost"),
    ],
)
def test_units_thresholds_and_levels_are_no_part_of_a_label(label, key):
    assert find_term(label).key == key


def test_what_needs_no_words_has_none():
    assert find_term("Seed") is None
    # Of a worker, in the episodes: no interval.
    assert find_term("Share") is None


def test_what_the_concepts_call_a_finding_is_defined():
    part = CONCEPTS.read_text().partition("### Results")[2].partition("###")[0]
    names = set(re.findall(r"^\| ([^|]+?) \|", part, re.MULTILINE)) - {"word"} - NO_FIGURES
    known = {name.lower() for term in list_terms() for name in (term.name, *term.labels)}
    assert {name for name in names if name.lower() not in known} == set()
