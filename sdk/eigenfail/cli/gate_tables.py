"""A gate as it is printed: known failures, reruns, what is new, and what it means."""

from collections.abc import Iterator

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from eigenfail.cli.figures import UNKNOWN
from eigenfail.cli.tables import table
from eigenfail.gate.conclusions import conclusions
from eigenfail.gate.found import Figures, Finding, Rerun
from eigenfail.gate.report import GateReport
from eigenfail.gate.verdicts import CLOSING, Verdict

SHOWN = 5
"""How many failures of each member that close the gate are printed; --json and JUnit have more."""


def gate_page(report: GateReport) -> Group:
    """All of it, for people."""
    return Group(*parts(report))


def parts(report: GateReport) -> Iterator[RenderableType]:
    """The parts of the page."""
    if any(member.known for member in report.members):
        yield known_table(report)
        yield Text()
    if any(member.rerun for member in report.members):
        yield rerun_table(report)
        yield Text()
    if told := list(to_look_at(report)):
        yield finding_table(told)
        yield Text()
    yield from map(Text, conclusions(report))


def known_table(report: GateReport) -> Table:
    """The known failures of the baseline, one a row."""
    grid = table("member", "known failure", "now", "replay")
    for member in report.members:
        for known in member.known:
            cells = (member.member, known.what, known.verdict, known.replay or UNKNOWN)
            grid.add_row(*map(escape, cells))
    return grid


def rerun_table(report: GateReport) -> Table:
    """The campaigns that were run again, one a row."""
    counted = ("baseline", "failures", "rerun", "failures now", "new", "fixed", "still failing")
    grid = table("member", *counted, "verdict", "because", right=counted)
    for member in report.members:
        if rerun := member.rerun:
            grid.add_row(*map(escape, (member.member, *rerun_row(rerun))))
    return grid


def rerun_row(rerun: Rerun) -> tuple[str, ...]:
    """Failures before and now, what became of them, and why."""
    sides = (of_side(rerun.before), of_side(rerun.now))
    told = (Verdict.NEW, Verdict.FIXED, Verdict.STILL_FAILING)
    nothing = UNKNOWN if rerun.unpaired_because else "0"
    counts = (str(rerun.counts.get(each, nothing)) for each in told)
    return (*sides[0], *sides[1], *counts, rerun.verdict, rerun.told)


def of_side(figures: Figures) -> tuple[str, str]:
    """A campaign, and how many of its episodes fail."""
    return str(figures.campaign), f"{figures.failures}/{figures.completed}"


def to_look_at(report: GateReport) -> Iterator[tuple[str, Finding]]:
    """New modes, and some of what closes the gate; of reruns as a whole, what was found."""
    for member in report.members:
        closing = [each for each in member.known if each.verdict in CLOSING]
        if rerun := member.rerun:
            yield from ((member.member, each) for each in rerun.new_modes)
            whole = rerun.unpaired_because and rerun.verdict in CLOSING
            closing += [each for each in rerun.findings if whole or each.verdict in CLOSING]
        yield from ((member.member, each) for each in closing[:SHOWN])


def finding_table(told: list[tuple[str, Finding]]) -> Table:
    """Episodes to look at, one a row."""
    grid = table("look at", "episode", "verdict", "replay", "page")
    for member, found in told:
        seen = (found.replay or found.problem, found.link)
        cells = (member, found.what, found.verdict, *seen)
        grid.add_row(*(escape(cell) for cell in cells))
    return grid
