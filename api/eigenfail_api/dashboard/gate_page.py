"""The pages of gates: their results as a list, and the report of one."""

import re
from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

from fastapi import APIRouter
from fastapi.responses import HTMLResponse

from eigenfail.gate.report import MemberReport, list_notes
from eigenfail.gate.results import GateResult, format_command
from eigenfail.gate.verdicts import GateVerdict, join_counts
from eigenfail.methods import traits_of
from eigenfail_api.dashboard.rendering import Badge, make_pager, page
from eigenfail_api.parameters import Before, Stored
from eigenfail_api.routes.versions import GateId

router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

SHOWN = 50
"""Results on a page of the list."""

BADGES = {
    "open": Badge("open", "✓", "good"),
    "closed": Badge("closed", "×", "bad"),
    "baseline": Badge("baseline", "○", "ended"),
}

TONES = {
    GateVerdict.NEW: Badge("new", "!", "bad"),
    GateVerdict.STILL_FAILING: Badge("still failing", "◆", "waiting"),
    GateVerdict.FIXED: Badge("fixed", "✓", "good"),
    GateVerdict.SAFE: Badge("safe", "○", "good"),
    GateVerdict.UNPROVEN: Badge("unproven", "?", "waiting"),
    GateVerdict.CANNOT_RUN: Badge("cannot be run", "!", "bad"),
}

_PAIR = re.compile(r"([1-9][0-9]{0,18})/([0-9]{1,18})")
"""An episode as CAMPAIGN/INDEX, or a mode as ANALYSIS/NUMBER."""


class PageLink(NamedTuple):
    """A text with the address of its page; empty if it has none."""

    text: str
    address: str = ""


def make_gate_view(result: GateResult) -> dict[str, object]:
    """Return what the page of a result shows."""
    gate = result.report.gate
    against = f" against {gate.baseline}" if gate.baseline else ""
    verdict, *conclusions = result.conclusions
    # The notes of a member stand in its own section.
    notes = {note for member in result.report.members for note in list_notes(member)}
    is_open = "open" if result.report.open else "closed"
    return {
        "id": result.id,
        "title": f"{gate.suite}: {gate.version}{against}",
        "badge": BADGES[is_open if gate.baseline else "baseline"],
        "verdict": verdict,
        "conclusions": [each for each in conclusions if each not in notes],
        "created_ms": result.created_ms,
        "members": [(each, tuple(list_links(each))) for each in result.report.members],
        "command": format_command(result.report),
    }


def list_links(member: MemberReport) -> Iterator[PageLink]:
    """Yield the campaigns of a member, and what compares them."""
    if member.baseline is None:
        return
    before = member.baseline.campaign
    yield PageLink(f"Baseline: campaign {before}", f"/campaigns/{before}")
    if rerun := member.rerun:
        now = rerun.now.campaign
        yield PageLink(f"Rerun: campaign {now}", f"/campaigns/{now}")
        yield PageLink("Comparison", f"/comparison?a={before}&b={now}")
        if traits_of(rerun.method).finds_new:
            yield PageLink("Failure modes of both releases", f"/releases/{now}")


def link_pair(text: str, address: str, place: str) -> PageLink:
    """Return a link to an episode or failure mode; it lacks an address if `place` lacks ids."""
    # The report holds what the gate was given, which need not be an address of this service.
    match = _PAIR.fullmatch(place)
    return (
        PageLink(text.format(*match.groups()), address.format(*match.groups()))
        if match
        else PageLink(place)
    )


@router.get("/gates")
def show_gates(store: Stored, before: Before = None) -> HTMLResponse:
    """Serve the results of gates, newest first."""
    found = store.gates.page(SHOWN, before)
    pages = make_pager("/gates", before, found.next)
    return page("gates.html", found, pages=pages, badges=BADGES, join_counts=join_counts)


@router.get("/gates/{gate}")
def show_gate(store: Stored, gate: GateId) -> HTMLResponse:
    """Serve the report of a gate."""
    return page(
        "gate.html",
        make_gate_view(store.gates.get(gate)),
        tones=TONES,
        join_counts=join_counts,
        link_episode=partial(link_pair, "{}/{}", "/campaigns/{}/episodes/{}"),
        link_mode=partial(link_pair, "mode {1} of analysis {0}", "/analyses/{}/modes/{}"),
    )
