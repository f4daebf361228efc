"""Results of gates that a service keeps: the report as it was judged, checked and bounded."""

import shlex
from typing import Any

import msgspec
from msgspec.structs import replace

from eigenfail.errors import InvalidValue
from eigenfail.gate.report import GateReport, build_report, describe_conclusion, list_conclusions
from eigenfail.gate.reruns import JudgedBy
from eigenfail.gate.verdicts import GateVerdict
from eigenfail.values.showing import Brief

LARGEST_REPORT = 900_000
"""Size of the JSON of a report that a service takes; see `shorten_report`. [bytes]"""

LEFT_OUT = "The report is larger than {:,} bytes: single episodes of reruns are left out."


class GateSummary(Brief, msgspec.Struct, frozen=True, kw_only=True):
    """The result of a gate in a list.

    Attributes:
        id: number of the result.
        created_ms: when the service got it, in milliseconds since 1970.
        suite: name of the suite.
        version: version of the planners under test.
        run: name of the run.
        baseline: version or run that it was compared with; empty if the run made one.
        open: whether nothing closes the gate.
        counts: how many known failures, episodes and campaigns there are of each verdict.
        conclusion: the verdict in a sentence.
    """

    id: int
    created_ms: int
    suite: str
    version: str
    run: str
    baseline: str
    open: bool
    counts: dict[GateVerdict, int]
    conclusion: str

    @property
    def verdict(self) -> str:
        """`open` or `closed`; `baseline` of a run that was compared with nothing."""
        if not self.baseline:
            return "baseline"
        return "open" if self.open else "closed"


class GateResult(Brief, msgspec.Struct, frozen=True, kw_only=True):
    """The result of a gate.

    Attributes:
        id: number of the result.
        created_ms: when the service got it, in milliseconds since 1970.
        conclusions: what the gate says of all of it, and what it cannot say, in sentences.
        report: the report, as `eigenfail gate --json` prints it.
    """

    id: int
    created_ms: int
    conclusions: tuple[str, ...]
    report: GateReport


def summarise_report(report: GateReport, number: int, created_ms: int) -> GateSummary:
    """Return a report as it stands in a list."""
    gate = report.gate
    return GateSummary(
        id=number,
        created_ms=created_ms,
        suite=gate.suite,
        version=gate.version,
        run=gate.run,
        baseline=gate.baseline,
        open=report.open,
        counts=report.counts,
        conclusion=describe_conclusion(report),
    )


def make_result(report: GateReport, number: int, created_ms: int) -> GateResult:
    """Return a report with its conclusions."""
    return GateResult(
        id=number,
        created_ms=created_ms,
        conclusions=tuple(list_conclusions(report)),
        report=report,
    )


def check_report(report: GateReport) -> None:
    """Make sure that the verdict and the counts of a report follow from its members.

    Raises:
        InvalidValue: one does not, or nothing but lost episodes keeps the gate closed, which says
            nothing of the planner.
    """
    again = build_report(report.gate, report.members)
    for name in ("counts", "open"):
        if getattr(again, name) != getattr(report, name):
            raise InvalidValue(
                name,
                "does not follow from the members of the report.",
                "Send the report as `eigenfail gate --json` printed it.",
            )
    if report.in_trouble:
        raise InvalidValue(
            "members",
            "have no verdict: episodes were lost because of the infrastructure.",
            "Check the workers, then run the gate for another version.",
        )


def shorten_report(report: GateReport) -> GateReport:
    """Return a report that a service takes: without episodes of reruns if it is too large.

    Verdicts and counts do not depend on them.
    """
    if len(msgspec.json.encode(report)) <= LARGEST_REPORT:
        return report
    members = []
    for each in report.members:
        changes: dict[str, Any] = {}
        if each.rerun and each.rerun.findings:
            changes["rerun"] = replace(each.rerun, findings=())
            changes["notes"] = (*each.notes, LEFT_OUT.format(LARGEST_REPORT))
        members.append(replace(each, **changes))
    return replace(report, members=tuple(members))


def format_command(report: GateReport) -> str:
    """Return the command that repeats a gate."""
    gate = report.gate
    words = ["eigenfail", "gate", gate.file or "FILE.toml", "--planner-version", gate.version]
    if gate.baseline:
        words += ["--baseline", gate.baseline]
    if gate.by is not JudgedBy.EPISODE:
        words += ["--by", gate.by]
    if gate.strict:
        words.append("--strict")
    return shlex.join(words)
