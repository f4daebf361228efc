"""Reports of gates as tables for a terminal."""

from collections.abc import Iterator, Sequence

from rich.console import Group
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from eigenfail.gate.report import GateReport, list_conclusions
from eigenfail.gate.reruns import GateFinding
from eigenfail.gate.results import GateSummary
from eigenfail.gate.verdicts import CLOSING, GateVerdict
from eigenfail.presentation.figures import UNKNOWN, format_utc
from eigenfail.presentation.terminal import start_grid

SHOWN = 5
"""How many failures of each member that close the gate are printed; --json and JUnit have more."""


def draw_report(report: GateReport) -> Group:
    """Return the tables of a report, and its conclusions in sentences."""
    drawn = [draw(report) for draw in (_draw_known, _draw_reruns, _draw_modes, _draw_findings)]
    spaced = [part for table in drawn if table.row_count for part in (table, Text())]
    return Group(*spaced, *map(Text, list_conclusions(report)))


def _draw_known(report: GateReport) -> Table:
    """The known failures of the baseline, one a row."""
    grid = start_grid("member", "known failure", "now", "replay")
    for member in report.members:
        for known in member.known:
            cells = (member.member, known.what, known.verdict, known.replay or UNKNOWN)
            grid.add_row(*map(escape, cells))
    return grid


def _draw_reruns(report: GateReport) -> Table:
    """The campaigns that were run again: failures before and now, what became of them, and why."""
    counted = ("baseline", "failures", "rerun", "failures now", "new", "fixed", "still failing")
    grid = start_grid("member", *counted, "verdict", "because", right=counted)
    for member in report.members:
        if (rerun := member.rerun) is None:
            continue
        sides = (
            text
            for side in (rerun.before, rerun.now)
            for text in (str(side.campaign), f"{side.failures}/{side.completed}")
        )
        nothing = UNKNOWN if rerun.unpaired_because else "0"
        verdicts = (GateVerdict.NEW, GateVerdict.FIXED, GateVerdict.STILL_FAILING)
        counts = (str(rerun.counts.get(each, nothing)) for each in verdicts)
        cells = (member.member, *sides, *counts, rerun.verdict, rerun.summary)
        grid.add_row(*map(escape, cells))
    return grid


def _draw_modes(report: GateReport) -> Table:
    """The failure modes of both versions, one a row."""
    counted = ("failures", "failures now")
    grid = start_grid("members", "failure mode", "over releases", *counted, right=counted)
    for each in report.matched:
        for mode in each.modes:
            numbers = (f"{mode.before:,}", f"{mode.now:,}")
            cells = (", ".join(each.members), mode.name, mode.status_word, *numbers)
            grid.add_row(*map(escape, cells))
    return grid


def _list_findings(report: GateReport) -> Iterator[tuple[str, GateFinding]]:
    """Return new modes and a bounded number of the findings that close the gate."""
    for member in report.members:
        closing = [each for each in member.known if each.verdict in CLOSING]
        if rerun := member.rerun:
            yield from ((member.member, each) for each in rerun.new_modes)
            whole = rerun.unpaired_because and rerun.verdict in CLOSING
            closing += [each for each in rerun.findings if whole or each.verdict in CLOSING]
        yield from ((member.member, each) for each in closing[:SHOWN])


def _draw_findings(report: GateReport) -> Table:
    """Episodes to look at, one a row."""
    grid = start_grid("look at", "episode", "verdict", "replay", "page")
    for member, found in _list_findings(report):
        seen = (found.replay or found.problem, found.link)
        cells = (member, found.what, found.verdict, *seen)
        grid.add_row(*(escape(cell) for cell in cells))
    return grid


def draw_summaries(found: Sequence[GateSummary]) -> Table:
    """Results of gates, one a row; times in UTC."""
    grid = start_grid("id", "suite", "version", "baseline", "verdict", "counts", "created")
    for each in found:
        counts = ", ".join(f"{count} {verdict}" for verdict, count in each.counts.items())
        cells = (each.suite, each.version, each.baseline or UNKNOWN, each.verdict)
        more = (counts or "none", format_utc(each.created_ms))
        grid.add_row(str(each.id), *map(escape, (*cells, *more)))
    return grid
