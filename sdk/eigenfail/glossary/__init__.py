"""What the figures of eigenfail are, in one source for pages, reports and the command line."""

import re
from functools import cache

from eigenfail.glossary.danger import DANGER, SEVERE
from eigenfail.glossary.grouping import COMPARED, MODES
from eigenfail.glossary.searching import FOUND, LIKELY, PRICES
from eigenfail.glossary.term import Term

__all__ = ["GLOSSARY", "Term", "term_of", "terms"]

GLOSSARY: dict[str, tuple[Term, ...]] = {
    "What was found": FOUND,
    "How likely it is": LIKELY,
    "What it cost": PRICES,
    "How near it came to a collision": DANGER,
    "How severe it was": SEVERE,
    "Kinds of failures": MODES,
    "Comparisons": COMPARED,
}
"""All words, by what they are about."""

MORE = re.compile(r", .*| \[.*| (?:below|above) .*| \d.*")
"""What follows a label: an interval, a unit, a threshold, a level."""


def terms() -> tuple[Term, ...]:
    """All words, in the order of the glossary."""
    return tuple(term for group in GLOSSARY.values() for term in group)


def term_of(label: str) -> Term | None:
    """The word under whose label figures stand; None where it needs no definition."""
    known = by_label()
    return known.get(label) or known.get(MORE.sub("", label))


@cache
def by_label() -> dict[str, Term]:
    """Every label with its word."""
    return {label: term for term in terms() for label in term.labels}
