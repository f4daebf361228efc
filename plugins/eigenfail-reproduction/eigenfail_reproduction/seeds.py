"""Verdicts on the paper's statements over several seeds, each with other campaigns."""

from collections.abc import Iterable, Sequence
from enum import StrEnum

import msgspec

from eigenfail_reproduction.paper import PaperReproduction, PaperStatement


class SeedVerdict(StrEnum):
    """Whether a statement of the paper holds over several seeds."""

    HOLDS = "holds"
    DOES_NOT_HOLD = "does not hold"
    CANNOT_BE_ASKED = "cannot be asked"


class JudgedStatement(msgspec.Struct, frozen=True, kw_only=True):
    """A statement of the paper, with the number of seeds that gave each answer.

    Attributes:
        subject: what of several campaigns it was judged by; empty if there is one choice.
        held: seeds in which it holds.
        refuted: seeds in which it does not hold.
        undecided: seeds in which it could be asked, and an interval includes no difference.
        unasked: seeds whose campaigns lack what it is about, such as failures to compare.
    """

    paper: str
    subject: str
    rule: str
    held: int
    refuted: int
    undecided: int
    unasked: int

    @property
    def seeds(self) -> int:
        """Number of seeds whose programme has the campaigns of this statement."""
        return self.held + self.refuted + self.undecided + self.unasked

    @property
    def verdict(self) -> SeedVerdict:
        """The verdict of most seeds.

        It cannot be asked unless it can be in more than half of the seeds; it holds if it does in
        more than half of them, and otherwise does not hold.
        """
        if 2 * self.unasked >= self.seeds:
            return SeedVerdict.CANNOT_BE_ASKED
        most_held = 2 * self.held > self.seeds
        return SeedVerdict.HOLDS if most_held else SeedVerdict.DOES_NOT_HOLD

    @property
    def is_shown(self) -> bool:
        """Whether more seeds give the verdict by their data than are undecided."""
        decided = self.held if self.verdict is SeedVerdict.HOLDS else self.refuted
        return decided > self.undecided


def judge_over_seeds(found: Sequence[PaperReproduction]) -> tuple[JudgedStatement, ...]:
    """Judge each statement by the reproductions of several seeds, in the order of the first one."""
    groups: dict[tuple[str, str], list[PaperStatement]] = {}
    for statement in (one for each in found for one in each.statements):
        groups.setdefault((statement.paper, statement.subject), []).append(statement)
    return tuple(_count_answers(group) for group in groups.values())


def _count_answers(group: Sequence[PaperStatement]) -> JudgedStatement:
    asked = [one.holds for one in group if one.asked]
    first = next((one for one in group if one.asked), group[0])
    return JudgedStatement(
        paper=first.paper,
        subject=first.subject,
        rule=first.rule,
        held=asked.count(True),
        refuted=asked.count(False),
        undecided=asked.count(None),
        unasked=len(group) - len(asked),
    )


def count_asked(judged: Iterable[JudgedStatement]) -> int:
    """Return the number of statements that hold or do not hold."""
    return sum(one.verdict is not SeedVerdict.CANNOT_BE_ASKED for one in judged)
