"""Triage, as a client sees it: state, ticket and note of failure modes."""

from typing import TypedDict, Unpack

from eigenfail.client.link import Link
from eigenfail.client.references import AnalysisLike, ModeLike, locate_mode
from eigenfail.values.triage import Triage, TriageChange, TriageState
from eigenfail.wire.http import read_fields


class TriageFields(TypedDict, total=False):
    """Fields of a change of triage; those that are left out do not change.

    Attributes:
        state: new, confirmed, known, fixed or not_a_bug.
        ticket: address of its ticket, beginning with https:// or http://; empty for none.
        note: the new note, in place of the one before; empty for none.
    """

    state: TriageState | str
    ticket: str
    note: str


class TriageRecords:
    """Read and change the triage of failure modes.

    Changes need a key of the scope runner where keys are required. Every method raises
    InvalidValue for a value that names no such thing, and ServiceUnreachable if no service answers.
    """

    def __init__(self, link: Link) -> None:
        self._link = link

    def get_mode(self, analysis: AnalysisLike, mode: ModeLike | None = None) -> Triage:
        """Return the triage of a failure mode.

        Args:
            analysis: the analysis, or its id; or the mode, as lists have it.
            mode: the mode, or its number, from 1; left out where `analysis` is the mode.

        Raises:
            NotFound: no such analysis or mode.
        """
        return self._link.get(f"{locate_mode(analysis, mode)}/triage", Triage)

    def change_mode(
        self, analysis: AnalysisLike, mode: ModeLike | None = None, **fields: Unpack[TriageFields]
    ) -> Triage:
        """Change the triage of a failure mode, and return it.

        Raises:
            NotFound: no such analysis or mode.
            InvalidValue: a value is outside its bounds, or the ticket is no address.
        """
        change = read_fields(fields, TriageChange)
        return self._link.post(f"{locate_mode(analysis, mode)}/triage", Triage, change)
