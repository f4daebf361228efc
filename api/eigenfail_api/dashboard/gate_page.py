"""The pages of gates: their results as a list, and the report of one."""

import re
from collections.abc import Iterator
from typing import NamedTuple

import msgspec
from fastapi import APIRouter
from fastapi.responses import HTMLResponse

from eigenfail.gate.matched import MatchedMode, MatchedModes
from eigenfail.gate.report import MemberReport, list_notes
from eigenfail.gate.reruns import GateFinding, Rerun
from eigenfail.gate.results import GateResult, GateSummary, format_command
from eigenfail.gate.verdicts import GateVerdict
from eigenfail.methods import traits_of
from eigenfail.presentation.figures import format_count
from eigenfail_api.dashboard.release_page import MARKS
from eigenfail_api.dashboard.rendering import Badge, Pager, make_pager, page, write_time
from eigenfail_api.parameters import Before, Stored
from eigenfail_api.routes.gates import GateId

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
    """A text with the address of its page; empty where it has none."""

    text: str
    address: str = ""


class GateLine(msgspec.Struct, frozen=True, kw_only=True):
    """The result of a gate in the table."""

    id: int
    suite: str
    version: str
    baseline: str
    badge: Badge
    counts: str
    created: str


class GatesView(msgspec.Struct, frozen=True, kw_only=True):
    """The list of results."""

    lines: tuple[GateLine, ...]
    pager: Pager


class FindingLine(msgspec.Struct, frozen=True, kw_only=True):
    """An episode, and what became of it.

    Attributes:
        what: what was injected, in words.
        was: episode of the baseline.
        mode: failure mode of the baseline.
        episode: episode of the new planner.
        note: why it errored, or the command that replays it.
    """

    what: str
    badge: Badge
    was: PageLink
    mode: PageLink
    episode: PageLink
    note: str


class RerunPart(msgspec.Struct, frozen=True, kw_only=True):
    """A campaign that was run again, and what became of it.

    Attributes:
        counts: numbers of its failing episodes by verdict, in words; empty where episodes were not
            compared one by one.
    """

    badge: Badge
    words: str
    before: str
    now: str
    counts: str
    findings: tuple[FindingLine, ...]
    new_modes: tuple[FindingLine, ...]


class ModeMatchLine(msgspec.Struct, frozen=True, kw_only=True):
    """A failure mode of both versions, matched over releases.

    Attributes:
        mark: class of the style of the status.
    """

    name: str
    mode: PageLink
    status: str
    mark: str
    before: str
    now: str
    words: str


class MemberPart(msgspec.Struct, frozen=True, kw_only=True):
    """A member of the suite.

    Attributes:
        links: campaigns of both versions, their comparison and their releases.
        limits: what could not be judged, in sentences.
    """

    name: str
    links: tuple[PageLink, ...]
    known: tuple[FindingLine, ...]
    rerun: RerunPart | None
    limits: tuple[str, ...]


class MatchedPart(msgspec.Struct, frozen=True, kw_only=True):
    """The failure modes of both versions in one scenario."""

    members: str
    releases: str
    modes: tuple[ModeMatchLine, ...]
    problem: str


class GateView(msgspec.Struct, frozen=True, kw_only=True):
    """The report of a gate.

    Attributes:
        verdict: the verdict in a sentence.
        conclusions: what it means, and what it cannot say.
        command: what repeats it.
    """

    id: int
    title: str
    badge: Badge
    verdict: str
    conclusions: tuple[str, ...]
    created: str
    members: tuple[MemberPart, ...]
    matched: tuple[MatchedPart, ...]
    command: str


def make_gate_line(summary: GateSummary) -> GateLine:
    """Return the line of a result."""
    return GateLine(
        id=summary.id,
        suite=summary.suite,
        version=summary.version,
        baseline=summary.baseline,
        badge=BADGES[summary.verdict],
        counts=_join_counts(summary.counts),
        created=write_time(summary.created_ms),
    )


def make_gate_view(result: GateResult) -> GateView:
    """Return the page of a result."""
    gate = result.report.gate
    against = f" against {gate.baseline}" if gate.baseline else ""
    verdict, *conclusions = result.conclusions
    # The notes of a member stand in its own section.
    notes = {note for member in result.report.members for note in list_notes(member)}
    is_open = "open" if result.report.open else "closed"
    return GateView(
        id=result.id,
        title=f"{gate.suite}: {gate.version}{against}",
        badge=BADGES[is_open if gate.baseline else "baseline"],
        verdict=verdict,
        conclusions=tuple(each for each in conclusions if each not in notes),
        created=write_time(result.created_ms),
        members=tuple(map(_make_member, result.report.members)),
        matched=tuple(map(_make_matched, result.report.matched)),
        command=format_command(result.report),
    )


def _make_member(member: MemberReport) -> MemberPart:
    rerun = member.rerun
    return MemberPart(
        name=member.member,
        links=tuple(_list_links(member)),
        known=tuple(map(_make_finding, member.known)),
        rerun=_make_rerun(rerun) if rerun else None,
        limits=(*member.notes, *(rerun.warnings if rerun else ())),
    )


def _list_links(member: MemberReport) -> Iterator[PageLink]:
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


def _make_rerun(rerun: Rerun) -> RerunPart:
    return RerunPart(
        badge=TONES[rerun.verdict],
        words=rerun.summary,
        before=f"{format_count(rerun.before.failures)} of {format_count(rerun.before.completed)}",
        now=f"{format_count(rerun.now.failures)} of {format_count(rerun.now.completed)}",
        counts=_join_counts(rerun.counts),
        findings=tuple(map(_make_finding, rerun.findings)),
        new_modes=tuple(map(_make_finding, rerun.new_modes)),
    )


def _make_finding(finding: GateFinding) -> FindingLine:
    return FindingLine(
        what=finding.what,
        badge=TONES[finding.verdict],
        was=_link_episode(finding.was),
        mode=_link_mode(finding.mode),
        episode=_link_episode(finding.episode),
        note=finding.problem or finding.replay,
    )


def _link_episode(place: str) -> PageLink:
    match = _PAIR.fullmatch(place)
    return PageLink(place, f"/campaigns/{match[1]}/episodes/{match[2]}" if match else "")


def _link_mode(place: str) -> PageLink:
    match = _PAIR.fullmatch(place)
    if match is None:
        return PageLink(place)
    text = f"mode {match[2]} of analysis {match[1]}"
    return PageLink(text, f"/analyses/{match[1]}/modes/{match[2]}")


def _make_matched(matched: MatchedModes) -> MatchedPart:
    return MatchedPart(
        members=", ".join(matched.members),
        releases=f"/releases/{matched.campaign}",
        modes=tuple(map(_make_mode_line, matched.modes)),
        problem=matched.problem,
    )


def _make_mode_line(mode: MatchedMode) -> ModeMatchLine:
    return ModeMatchLine(
        name=mode.name,
        mode=_link_mode(mode.mode),
        status=mode.status_word.capitalize(),
        mark=MARKS[mode.status] if mode.status else "",
        before=format_count(mode.before),
        now=format_count(mode.now),
        words=mode.words,
    )


def _join_counts(counts: dict[GateVerdict, int]) -> str:
    return ", ".join(f"{format_count(count)} {verdict}" for verdict, count in counts.items())


@router.get("/gates")
def show_gates(store: Stored, before: Before = None) -> HTMLResponse:
    """Serve the results of gates, newest first."""
    found = store.gates.page(SHOWN, before)
    lines = tuple(map(make_gate_line, found.items))
    pager = make_pager("/gates", before, found.next)
    return page("gates.html", GatesView(lines=lines, pager=pager))


@router.get("/gates/{gate}")
def show_gate(store: Stored, gate: GateId) -> HTMLResponse:
    """Serve the report of a gate."""
    return page("gate.html", make_gate_view(store.gates.get(gate)))
