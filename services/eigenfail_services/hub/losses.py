"""How a learner may be lost, and how often in a row before its campaign is given up."""

from collections import Counter
from enum import StrEnum

import msgspec


class Kind(StrEnum):
    """What became of it."""

    DIED = "died"
    DIVERGED = "diverged"
    HUNG = "hung"


MOST = {Kind.DIED: 3, Kind.DIVERGED: 2, Kind.HUNG: 2}
"""Losses in a row, without a round learnt in between, with which a campaign ends.

What a learner does follows from its checkpoint and the results. NaN and a step without an end are
survived once, in case a bit was flipped or two threads met; when they come again from the same
checkpoint, they would come for ever. A death may be the machine's doing, and has one more try.
"""

MOST_OF_ALL = max(MOST.values())

PAUSES_S = (0.0, 1.0, 5.0)
"""Before a life that follows so many losses: what a machine has run out of, it often has soon."""


class Loss(msgspec.Struct, frozen=True):
    """Why a learner is no more.

    Attributes:
        problem: what happened, in a sentence.
        remedy: what to do, should it not pass.
    """

    kind: Kind
    problem: str
    remedy: str


def died(status: int) -> Loss:
    """Its process ended, and it did not say why."""
    return Loss(
        Kind.DIED,
        f"The learner process died with exit status {status}.",
        "Its log says why, and memory is the usual reason; start a campaign like it anew.",
    )


def hung(limit_s: float) -> Loss:
    """It was at one step for too long."""
    return Loss(
        Kind.HUNG,
        f"The learner took more than {limit_s:g} s over one step, and was killed.",
        "If its settings ask for so much training, start the services with a larger "
        "--learner-limit; else correct the method. Then start a campaign like it anew.",
    )


class Losses:
    """Those in a row."""

    def __init__(self) -> None:
        self._counts = Counter[Kind]()

    def forget(self) -> None:
        """A round was learnt: the next loss is the first one again."""
        self._counts.clear()

    def add(self, loss: Loss) -> None:
        """It happened, and the learner begins again."""
        self._counts[loss.kind] += 1

    @property
    def pause_s(self) -> float:
        """How long the next life waits for its begin, with what was lost so far."""
        return PAUSES_S[min(self._counts.total(), len(PAUSES_S) - 1)]

    def end_with(self, loss: Loss) -> str:
        """Why the campaign ends with this one; empty if the learner may begin again."""
        times = self._counts.total() + 1
        if self._counts[loss.kind] + 1 < MOST[loss.kind] and times < MOST_OF_ALL:
            return ""
        again = f"The learner was lost {times} times in a row, from one checkpoint."
        return f"{loss.problem} {again} {loss.remedy}".strip()
