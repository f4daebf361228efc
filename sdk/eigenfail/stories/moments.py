"""Moments of an explained episode to which one may want to jump."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import msgspec

from eigenfail.stories.sentences import figure, word
from eigenfail.values import ExplainedStep

MOST = 12
NOTHING = frozenset({"", "none"})
SOLVED = frozenset({"", "solved"})


class Notable(msgspec.Struct, frozen=True):
    """Something that happened at a moment."""

    time_s: float
    words: str


def notable(steps: Sequence[ExplainedStep]) -> tuple[Notable, ...]:
    """The first of them in the order of time: lost tracks, overrides, programs without a solution.

    The names looked for in the account are those of `ExplainingPlanner`.
    """
    found = (one for before, now in pairwise(steps) for one in begun(before, now))
    return tuple(one for one, _ in zip(found, range(MOST), strict=False))


def begun(before: ExplainedStep, now: ExplainedStep) -> Iterator[Notable]:
    """What begins at a step."""
    if figure(now, "lost_tracks") > figure(before, "lost_tracks"):
        yield Notable(now.time_s, "track lost")
    override = word(now, "override")
    if override not in NOTHING and override != word(before, "override"):
        yield Notable(now.time_s, override.replace("_", " "))
    if word(now, "qp_status") not in SOLVED and word(before, "qp_status") in SOLVED:
        yield Notable(now.time_s, "program not solved")
