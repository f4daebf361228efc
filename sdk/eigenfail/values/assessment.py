"""What outcome and measures of an episode say together: its conflict class and lead times.

Thresholds are the paper's (section on safety measures, after FHWA-RD-03-050).
"""

from enum import StrEnum
from typing import Annotated

import msgspec

from eigenfail.values.episode import Outcome
from eigenfail.values.measures import Measure, Measures, read_declarations

NEAR_MISS_TTC_S = 1.5
"""A time to collision below this is a violation."""

PEAK_BRAKING_MPS2 = 7.0
"""What the truck's brakes can do: a DRAC above it is a violation."""


class ConflictClass(StrEnum):
    """How dangerous an episode was, and whose failure a collision is.

    `unavoidable`: a collision that peak braking could not avoid once it showed, or that never
    showed before the contact. `planner_failure`: a collision that was not shown to be
    unavoidable. `near_miss`: MinTTC < 1.5 s without a collision. `none`: nothing of these.
    """

    UNAVOIDABLE = "unavoidable"
    PLANNER_FAILURE = "planner_failure"
    NEAR_MISS = "near_miss"
    NONE = "none"


IN_WORDS = {
    ConflictClass.UNAVOIDABLE: "collision, unavoidable",
    ConflictClass.PLANNER_FAILURE: "collision, planner failure",
    ConflictClass.NEAR_MISS: "near miss",
    ConflictClass.NONE: "no conflict",
}

UNRESOLVED = "unresolved at the horizon"
"""Beside the class of an episode that ended too early to be called safe."""


class Assessment(msgspec.Struct, frozen=True):
    """What an episode was.

    Attributes:
        conflict: its class; None if it was not run, or ended in a collision that was stored
            before there were classes.
        ttc_lead_s: from the first violation of MinTTC to the collision [s]; None without either.
        drac_lead_s: the same for DRAC.
        unresolved: whether it ended at its horizon while braking could not avoid a collision any
            more; None if that is not known: an older release did not measure enough to say, or an
            older service does not tell.
    """

    conflict: ConflictClass | None = None
    ttc_lead_s: Annotated[
        float | None,
        Measure(
            label="lead time of TTC",
            unit="s",
            words="from ttc_violated_s to the collision",
            formula="`collided_s` − `ttc_violated_s`",
        ),
    ] = None
    drac_lead_s: Annotated[
        float | None,
        Measure(
            label="lead time of DRAC",
            unit="s",
            words="from drac_violated_s to the collision",
            formula="`collided_s` − `drac_violated_s`",
        ),
    ] = None
    unresolved: bool | None = None

    @property
    def words(self) -> str:
        """The class in words; empty if there is none."""
        return self.beside(IN_WORDS[self.conflict] if self.conflict else "")

    def beside(self, words: str) -> str:
        """Words on the episode, and whether it was unresolved at the horizon."""
        return ", ".join(filter(None, (words, UNRESOLVED if self.unresolved else "")))


LEAD_TIMES = read_declarations(Assessment)
"""Declarations of the measures that follow from outcome and measures."""


def assess(outcome: Outcome, measures: Measures | None) -> Assessment:
    """Classify an episode.

    A collision is judged by DRAC at the first violation of MinTTC by the vehicle struck, not by
    its maximum: DRAC = v² / (2 · gap) tends to infinity at contact, so that every collision would
    be called unavoidable.
    """
    if measures is None or outcome is Outcome.FAILED:
        return Assessment(unresolved=False)
    if outcome is Outcome.SAFE:
        near = measures.min_ttc_s is not None and measures.min_ttc_s < NEAR_MISS_TTC_S
        conflict = ConflictClass.NEAR_MISS if near else ConflictClass.NONE
        return Assessment(conflict, unresolved=is_unresolved(measures))
    return Assessment(
        _of_collision(measures),
        _lead_s(measures, measures.ttc_violated_s),
        _lead_s(measures, measures.drac_violated_s),
        unresolved=False,
    )


def is_unresolved(measures: Measures) -> bool | None:
    """Whether an episode without a collision ended while braking could not avoid one any more.

    At a closing speed v and a gap g, constant braking avoids the crash if v² / (2 · g), which is
    DRAC (FHWA-RD-03-050), is at most what the brakes can do; others are taken to keep their
    velocities. None where the last step's DRAC is not known and the largest does not settle it.
    """
    if measures.max_drac_mps2 is None or measures.max_drac_mps2 <= PEAK_BRAKING_MPS2:
        return False
    last_mps2 = measures.final_drac_mps2
    return None if last_mps2 is None else last_mps2 > PEAK_BRAKING_MPS2


def _of_collision(measures: Measures) -> ConflictClass | None:
    if measures.collided_s is None:
        return None
    need_mps2 = measures.drac_at_warning_mps2
    hopeless = need_mps2 is None or need_mps2 > PEAK_BRAKING_MPS2
    return ConflictClass.UNAVOIDABLE if hopeless else ConflictClass.PLANNER_FAILURE


def _lead_s(measures: Measures, violated_s: float | None) -> float | None:
    if measures.collided_s is None or violated_s is None:
        return None
    return measures.collided_s - violated_s
