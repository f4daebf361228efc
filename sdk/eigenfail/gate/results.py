"""Results of gates that a service keeps: reports, checked and bounded in size."""

import shlex
from collections import Counter
from collections.abc import Sequence

import msgspec
from msgspec.structs import replace

from eigenfail.errors import InvalidValue
from eigenfail.gate.report import (
    GateReport,
    MemberReport,
    build_report,
    describe_conclusion,
    list_conclusions,
)
from eigenfail.gate.reruns import GateFinding, JudgedBy
from eigenfail.gate.verdicts import CLOSING, INFRASTRUCTURE, GateVerdict
from eigenfail.values.showing import Brief

LARGEST_REPORT = 900_000
"""Size of the JSON of a report that a service takes; see `shorten_report`. [bytes]"""

LEFT_OUT = "The report is larger than {:,} bytes: single episodes of reruns are left out."

MOST_KNOWN = 10
"""Known failures of a member in a report that is too large without episodes of reruns, too."""

KNOWN_LEFT_OUT = (
    "The report is larger than {:,} bytes: {:,} known failures are left out, but counted."
)


class GateSummary(Brief, msgspec.Struct, frozen=True, kw_only=True):
    """The result of a gate in a list.

    Attributes:
        id: number of the result.
        created_ms: when the service received it, in milliseconds since 1970.
        suite: name of the suite.
        version: version of the planners under test.
        run: name of the run.
        baseline: version or run that it was compared with; empty if the run made one.
        open: whether nothing closes the gate.
        counts: number of known failures, episodes and campaigns by verdict.
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
        """`open` or `closed`; `baseline` for a run without a comparison."""
        if not self.baseline:
            return "baseline"
        return "open" if self.open else "closed"


class GateResult(Brief, msgspec.Struct, frozen=True, kw_only=True):
    """The result of a gate.

    Attributes:
        id: number of the result.
        created_ms: when the service received it, in milliseconds since 1970.
        conclusions: the gate's conclusion and its limits, in sentences.
        report: the report, as `eigenfail gate --json` prints it.
    """

    id: int
    created_ms: int
    conclusions: tuple[str, ...]
    report: GateReport


def summarise_report(report: GateReport, number: int, created_ms: int) -> GateSummary:
    """Return the list entry for a report."""
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
    """Check that the verdict and the counts of a report follow from its members.

    Raises:
        InvalidValue: one does not follow, or the gate does not allow a conclusion on the planner,
            since only lost episodes keep it closed.
    """
    # A client says what it found, not what follows from it: a verdict is never taken on trust.
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
    """Return a report that a service accepts: without episodes of reruns if it is too large.

    If it is still too large, each member keeps at most `MOST_KNOWN` known failures, first those
    that close the gate. Verdicts and counts do not change. An inconclusive gate stays inconclusive,
    since one errored episode is kept.
    """
    # Reruns first: their episodes can be listed again, known failures are what a gate is about.
    for shorten in (_drop_rerun_episodes, _shorten_known):
        if len(msgspec.json.encode(report)) <= LARGEST_REPORT:
            break
        report = replace(report, members=tuple(map(shorten, report.members)))
    return report


def _drop_rerun_episodes(member: MemberReport) -> MemberReport:
    """Return a member without the episodes of its rerun, except one that errored."""
    rerun = member.rerun
    kept = _pick_errored_example(rerun.findings) if rerun else ()
    if rerun is None or len(kept) == len(rerun.findings):
        return member
    notes = (*member.notes, LEFT_OUT.format(LARGEST_REPORT))
    return replace(member, rerun=replace(rerun, findings=kept), notes=notes)


def _shorten_known(member: MemberReport) -> MemberReport:
    """Return a member with at most `MOST_KNOWN` known failures, and a count of all further ones."""
    if len(member.known) <= MOST_KNOWN:
        return member
    errored = _pick_errored_example(member.known)
    ordered = sorted(
        member.known,
        key=lambda each: (all(each is not kept for kept in errored), each.verdict not in CLOSING),
    )
    left_out = Counter(each.verdict for each in ordered[MOST_KNOWN:])
    note = KNOWN_LEFT_OUT.format(LARGEST_REPORT, left_out.total())
    return replace(
        member,
        known=tuple(ordered[:MOST_KNOWN]),
        known_left_out=dict(left_out),
        notes=(*member.notes, note),
    )


def _pick_errored_example(findings: Sequence[GateFinding]) -> tuple[GateFinding, ...]:
    """Return one errored episode, preferably one with a fault outside the infrastructure."""
    errored = [each for each in findings if each.verdict is GateVerdict.CANNOT_RUN]
    return tuple(sorted(errored, key=lambda each: each.problem.startswith(INFRASTRUCTURE))[:1])


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
