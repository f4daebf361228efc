"""The glossary: what the figures on the pages are, and its page."""

import re
import tomllib
from functools import cache
from pathlib import Path

import msgspec
from fastapi import APIRouter
from fastapi.responses import HTMLResponse

from eigenfail_api.dashboard.rendering import TEMPLATES, page

FILE = Path(__file__).with_name("glossary.toml")


MORE = re.compile(r", .*| \[.*| (?:below|above) .*| \d.*")
"""The text behind a label: an interval, a unit, a threshold, a level."""


class Term(msgspec.Struct, frozen=True, kw_only=True):
    """Definition of a figure, in a sentence or two.

    Attributes:
        key: identifier of the term in addresses.
        name: name of the term.
        words: definition of the figure, and what the figure does not mean.
        unit: unit of the figure; empty without one.
        labels: labels of the figure in tables and on pages, without unit, threshold or interval.
    """

    key: str
    name: str
    words: str
    unit: str = ""
    labels: tuple[str, ...] = ()


class TermGroup(msgspec.Struct, frozen=True):
    """Terms on one subject."""

    title: str
    terms: tuple[Term, ...]


@cache
def read_glossary() -> tuple[TermGroup, ...]:
    """Return all terms, grouped by subject."""
    return msgspec.convert(tomllib.loads(FILE.read_text())["group"], tuple[TermGroup, ...])


def list_terms() -> tuple[Term, ...]:
    """Return all terms in the order of the glossary."""
    return tuple(term for group in read_glossary() for term in group.terms)


def find_term(label: str) -> Term | None:
    """Return the term for the label of a figure; None if the figure needs no definition."""
    by_label = _map_labels()
    return by_label.get(label) or by_label.get(MORE.sub("", label))


@cache
def _map_labels() -> dict[str, Term]:
    return {label: term for term in list_terms() for label in term.labels}


# Beside every label that has a term, pages show a button with its definition.
TEMPLATES.globals["term_of"] = find_term

router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)


@router.get("/glossary")
def show_glossary() -> HTMLResponse:
    """Show all terms with their definitions and units."""
    return page("glossary.html", read_glossary())
