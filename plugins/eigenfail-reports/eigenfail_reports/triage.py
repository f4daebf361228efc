"""Triage of the modes of a report."""

from collections.abc import Iterator
from typing import NamedTuple

from eigenfail.presentation.figures import count_noun, format_utc
from eigenfail.values.analysis import Mode
from eigenfail.values.triage import Triage
from eigenfail_reports.material import Material
from eigenfail_reports.page import ColumnOf, ReportPart, tabulate

MOST_REPORTED = 1_000
"""Modes of a campaign whose triage stands in a report, those of the lowest numbers."""

TRIAGE = "triage"

HOW_TO_READ = (
    "Triage is an assessment of the results by people, and no part of them: it enters no digest. "
    "It stands here as it was when the report was made, for all modes of the newest analysis."
)


class _Triaged(NamedTuple):
    """A mode with its triage."""

    campaign: int
    mode: Mode
    triage: Triage


COLUMNS: tuple[ColumnOf[_Triaged], ...] = (
    ("campaign", "Campaign", "", lambda each: each.campaign),
    ("analysis", "Analysis", "", lambda each: each.mode.analysis),
    ("number", "Number", "", lambda each: each.mode.number),
    ("name", "Name", "", lambda each: each.mode.name),
    ("state", "State", "", lambda each: each.triage.state.words),
    ("ticket", "Ticket", "", lambda each: each.triage.ticket),
    ("note", "Note", "", lambda each: each.triage.note),
    ("changed", "Changed last", "", lambda each: format_utc(each.triage.changed_ms)),
    ("changed_by", "Changed by", "", lambda each: each.triage.changed_by),
)


def make_triage(material: Material) -> ReportPart | None:
    """Return the triage of modes; None without a mode."""
    found = list(_list_all(material))
    if not found:
        return None
    bound = f"At most {MOST_REPORTED:,} modes of each campaign."
    return ReportPart(
        name="triage",
        title="Triage",
        words=(HOW_TO_READ, *_count_states(found)),
        tables=(tabulate(TRIAGE, "Triage", COLUMNS, found, bound),),
    )


def _list_all(material: Material) -> Iterator[_Triaged]:
    """Yield all modes of the newest analysis of each campaign."""
    store = material.store
    for subject in material.subjects:
        if subject.analysis is not None:
            for mode in store.analyses.modes(subject.analysis.id)[:MOST_REPORTED]:
                triage = store.analyses.get_triage(subject.analysis.id, mode.number)
                yield _Triaged(subject.id, mode, triage)


def _count_states(found: list[_Triaged]) -> Iterator[str]:
    """Yield how many modes are in each state, in a sentence for each campaign."""
    for campaign in dict.fromkeys(each.campaign for each in found):
        ours = [each.triage.state.words for each in found if each.campaign == campaign]
        states = (f"{ours.count(state)} {state}" for state in sorted(set(ours)))
        yield f"Campaign {campaign}: {count_noun(len(ours), 'mode')}: {', '.join(states)}."
