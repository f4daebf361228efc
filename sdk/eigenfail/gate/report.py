"""The findings of a gate, and whether it is open.

The report is also written as JUnit XML, which Jenkins, GitLab and GitHub read. Each member of the
suite is a `testsuite`. Each known failure and each rerun campaign is a `testcase`, and so is each
new failure mode and new failure of a rerun. A finding that closes the gate is a `failure`, and one
that cannot be run is an `error`. Findings that the baseline had already, or that cannot be judged,
are `skipped`.
"""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from math import prod
from typing import NamedTuple
from xml.etree import ElementTree as ET

import msgspec
from msgspec.structs import replace

from eigenfail.gate import verdicts
from eigenfail.gate.known import NEW_MODE
from eigenfail.gate.reruns import (
    GateFinding,
    JudgedBy,
    ReportName,
    ReportSentence,
    Rerun,
    RerunFigures,
)
from eigenfail.settings import Count

INCONCLUSIVE = "inconclusive"


class MemberReport(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The verdict on one member of the suite.

    Attributes:
        baseline: the member's baseline campaign; None if it is missing, so that nothing is judged.
        known: verdicts on the replayed known failures.
        known_left_out: number of further known failures by verdict, in a report that was too large
            for a service; empty if `known` is complete.
        rerun: the rerun campaign; None if the baseline is the version itself.
        notes: steps that could not be done, in sentences.
    """

    member: ReportName
    baseline: RerunFigures | None = None
    known: tuple[GateFinding, ...] = ()
    known_left_out: dict[verdicts.GateVerdict, Count] = {}
    rerun: Rerun | None = None
    notes: tuple[ReportSentence, ...] = ()

    def count_verdicts(self) -> Counter[verdicts.GateVerdict]:
        """Count the verdicts on known failures and on the rerun, by episode or as a whole."""
        counts = Counter(finding.verdict for finding in self.known)
        counts.update(self.known_left_out)
        if self.rerun is not None and self.rerun.by is JudgedBy.EPISODE:
            counts.update(self.rerun.counts)
        if self.rerun is not None and self.rerun.by is JudgedBy.RATE:
            counts[self.rerun.verdict] += 1
        return counts


class GateRun(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The inputs of a gate.

    Attributes:
        version: version of the planners under test.
        run: the name of this run, which later gates can take as their baseline.
        baseline: the baseline as the user named it; empty if this run makes one.
        strict: whether failures that are still failing or unproven close the gate, too.
        by: basis for the verdict on campaigns under the same noise.
        file: file of the suite, as the command named it; empty if not known.
    """

    suite: ReportName
    version: ReportName
    run: ReportName
    baseline: ReportSentence = ""
    strict: bool = False
    by: JudgedBy = JudgedBy.EPISODE
    file: ReportSentence = ""

    @property
    def closing(self) -> frozenset[verdicts.GateVerdict]:
        """Verdicts that close the gate."""
        return verdicts.STRICTLY_CLOSING if self.strict else verdicts.CLOSING


class GateReport(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The findings of a gate.

    Attributes:
        counts: number of known failures, episodes and campaigns by verdict.
        open: whether nothing closes the gate, and no episode may hide a failure that would.
    """

    gate: GateRun
    open: bool
    counts: dict[verdicts.GateVerdict, Count]
    members: tuple[MemberReport, ...]

    def problems(self) -> Iterator[str]:
        """Yield the reasons why episodes errored."""
        for member in self.members:
            findings = (*member.known, *(member.rerun.findings if member.rerun else ()))
            yield from (
                each.problem for each in findings if each.verdict is verdicts.GateVerdict.CANNOT_RUN
            )

    def list_doubts(self) -> Iterator[str]:
        """Yield the episodes of each member that may hide a failure that closes the gate."""
        for member in self.members:
            if member.rerun and member.rerun.doubt:
                yield member.rerun.doubt

    @property
    def state(self) -> str:
        """`open`, `closed`, or `inconclusive` if only episodes in doubt keep the gate closed."""
        if self.open:
            return "open"
        return "closed" if self.gate.closing & self.counts.keys() else INCONCLUSIVE

    @property
    def in_trouble(self) -> bool:
        """True if the gate does not allow a conclusion on the planner.

        Only faults of the infrastructure, or episodes that may hide a failure, keep it closed.
        """
        closing = self.gate.closing & self.counts.keys()
        if not closing:
            return not self.open
        problems = tuple(self.problems())
        return (
            closing == {verdicts.GateVerdict.CANNOT_RUN}
            and bool(problems)
            and all(problem.startswith(verdicts.INFRASTRUCTURE) for problem in problems)
        )


def build_report(gate: GateRun, members: Sequence[MemberReport]) -> GateReport:
    """Return the report of a gate, with the counts of its verdicts and whether it is open."""
    seen = Counter[verdicts.GateVerdict]()
    for member in members:
        seen.update(member.count_verdicts())
    # In the order of the verdicts, so that equal gates have equal reports, byte for byte.
    counts = {verdict: seen[verdict] for verdict in verdicts.GateVerdict if seen[verdict]}
    # A doubtful episode may hide what closes the gate: "open" is only said where none is left.
    report = GateReport(
        gate=gate,
        open=gate.closing.isdisjoint(counts),
        counts=counts,
        members=tuple(members),
    )
    return replace(report, open=False) if any(report.list_doubts()) else report


# Names and problems are texts of users and plug-ins; one such character makes the file unreadable.
ILLEGAL = re.compile("[^\t\n\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that an XML 1.0 document cannot hold, or does not keep."""

NOT_SAFE = frozenset(verdicts.GateVerdict) - {verdicts.GateVerdict.SAFE, verdicts.GateVerdict.FIXED}


class _TestCase(NamedTuple):
    """A test case: its group, name, verdict, details and wall time."""

    group: str
    name: str
    verdict: verdicts.GateVerdict | None
    details: str
    wall_s: float = 0.0


def to_junit(report: GateReport) -> bytes:
    """Return the JUnit document of a report, encoded as UTF-8."""
    root = ET.Element("testsuites", name=_remove_illegal(f"eigenfail gate {report.gate.run}"))
    gate = report.gate
    for member in report.members:
        name = _remove_illegal(f"{gate.suite}: {member.member}")
        suite = ET.SubElement(root, "testsuite", name=name)
        suite.extend(_build_case(case, name, gate) for case in _list_cases(member))
        _write_totals(suite, list(suite))
        # The schema of the format has properties in front of the cases.
        properties = ET.Element("properties")
        suite.insert(0, properties)
        for name, value in _list_properties(member, gate):
            ET.SubElement(properties, "property", name=name, value=_remove_illegal(value))
    _write_totals(root, list(root.iter("testcase")))
    ET.indent(root)
    document: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return document + b"\n"


def _list_properties(member: MemberReport, gate: GateRun) -> Iterator[tuple[str, str]]:
    """Yield the basis of the member's verdicts, by name."""
    yield "version", gate.version
    yield "baseline", gate.baseline
    if member.baseline is not None:
        yield "baseline campaign", str(member.baseline.campaign)
    if rerun := member.rerun:
        yield "campaign", str(rerun.now.campaign)
        yield "failures", f"{rerun.now.failures} of {rerun.now.completed}"
        yield "failures before", f"{rerun.before.failures} of {rerun.before.completed}"
        yield from ((str(each), str(count)) for each, count in rerun.counts.items())


def _list_cases(member: MemberReport) -> Iterator[_TestCase]:
    """Yield the test cases of a member."""
    for note in member.notes:
        yield _TestCase("baseline", note, None, note)
    for known in member.known:
        yield _TestCase(
            "known failures", known.what, known.verdict, _format_details(known), known.wall_s
        )
    if rerun := member.rerun:
        replays = (f"{each.what}: {_format_details(each)}" for each in rerun.findings)
        yield _TestCase(
            "rerun",
            f"campaign {rerun.before.campaign}",
            rerun.verdict,
            "\n".join([rerun.summary, *replays]),
            rerun.wall_s,
        )
        if rerun.doubt:
            text = f"{rerun.doubt} may hide a new failure."
            yield _TestCase("rerun", "hidden failures", verdicts.GateVerdict.CANNOT_RUN, text)
        for each in rerun.new_modes:
            # Modes of a search are not judged: another search of the same planner may find others.
            verdict = each.verdict if rerun.judges_modes else None
            details = f"{_format_details(each)}\n{rerun.modes}"
            yield _TestCase("new modes", each.what, verdict, details, each.wall_s)
        for each in rerun.findings:
            if rerun.by is JudgedBy.EPISODE and each.verdict in verdicts.CLOSING:
                yield _TestCase(
                    "rerun", each.what, each.verdict, _format_details(each), each.wall_s
                )


def _format_details(finding: GateFinding) -> str:
    """Return how to inspect a finding."""
    return "\n".join(filter(None, (finding.problem, finding.replay, finding.link)))


def _build_case(case: _TestCase, suite: str, gate: GateRun) -> ET.Element:
    """Return the element of a test case, with its outcome."""
    found = ET.Element(
        "testcase",
        classname=_remove_illegal(f"{suite}.{case.group}"),
        name=_remove_illegal(case.name),
    )
    found.set("time", f"{case.wall_s:.3f}")
    message = case.verdict or "not judged"
    if tag := _choose_tag(case.verdict, gate):
        ET.SubElement(found, tag, message=message, type=message).text = _remove_illegal(
            case.details
        )
    else:
        ET.SubElement(found, "system-out").text = _remove_illegal(f"{message}\n{case.details}")
    return found


def _choose_tag(verdict: verdicts.GateVerdict | None, gate: GateRun) -> str:
    """Return the name of the element for a case's outcome; empty for a passed case."""
    if verdict is verdicts.GateVerdict.CANNOT_RUN:
        return "error"
    if verdict in gate.closing:
        return "failure"
    return "skipped" if verdict is None or verdict in NOT_SAFE else ""


def _write_totals(group: ET.Element, found: list[ET.Element]) -> None:
    """Write the number of cases of a group, in total and by outcome."""
    tags = {"failures": "failure", "errors": "error", "skipped": "skipped"}
    group.set("tests", str(len(found)))
    for name, tag in tags.items():
        group.set(name, str(sum(each.find(tag) is not None for each in found)))
    group.set("time", f"{sum(float(each.get('time', '0')) for each in found):.3f}")


def _remove_illegal(text: str) -> str:
    """Return the text without characters that XML cannot hold."""
    return ILLEGAL.sub("", text)


RISEN = 0.025
"""How often a rate that did not rise is taken for one that did, at most: one side of 95 %."""


FIRST = 0.25
"""How often there is no failure in a campaign and one in the next, at most: with q the probability
of none, q (1 - q)."""


FIRST_OF_PAIRS = 0.5
"""The same where only pairs in which one side failed matter: of a single one, each side's turn."""


FIRST_FAILURE = "there one failure will do, and more of the runs against it may be called new"
"""The share is of pairs of runs: of the runs against a baseline that is kept it may be larger."""


OFTENER = "; failures of a search follow each other, so that it may be more often there"


def list_conclusions(report: GateReport) -> Iterator[str]:
    """Yield the gate's conclusion and its limits, in sentences."""
    yield describe_conclusion(report)
    yield from _list_caveats(report)


def describe_conclusion(report: GateReport) -> str:
    """Return whether the gate is open, and why, in a sentence."""
    counts = verdicts.join_counts(report.counts)
    gate = report.gate
    if not gate.baseline:
        found = _describe_findings(report)
        return f"{gate.run} can be a baseline (--baseline {gate.version}): {found}."
    judged = f"The gate of {gate.run} against {gate.baseline} is {report.state}"
    if report.state == INCONCLUSIVE:
        return f"{judged}: {', '.join(report.list_doubts())} may hide a new failure."
    if not counts:
        return f"{judged}: no failure on either side."
    return f"{judged}. Known failures, episodes and campaigns together: {counts}."


def _describe_findings(report: GateReport) -> str:
    """Return the findings of a run that makes a baseline, in words."""
    seen = [member.baseline for member in report.members if member.baseline]
    failures, completed = (
        sum(getattr(each, name) for each in seen) for name in ("failures", "completed")
    )
    counts = verdicts.join_counts(report.counts)
    known = f"; of its known failures, replayed: {counts}" if counts else ""
    return f"{failures} of {completed} episodes fail{known}"


def _list_caveats(report: GateReport) -> Iterator[str]:
    """Yield the limits of an open or a closed gate, in sentences."""
    reruns = [each.rerun for each in report.members if each.rerun]
    if by_rate := [rerun for rerun in reruns if rerun.by is JudgedBy.RATE]:
        yield _describe_false_alarms(by_rate)
    if new_modes := sum(len(rerun.new_modes) for rerun in reruns if not rerun.judges_modes):
        yield (
            f"Reported, not judged: failure modes of searches that only {report.gate.version} has:"
            f" {new_modes}. Replay them; whether they come back, the same search from other seeds"
            " says."
        )
    by_chance = [rerun for rerun in reruns if rerun.verdict is not verdicts.GateVerdict.NEW]
    if within := sum(rerun.counts.get(verdicts.GateVerdict.NEW, 0) for rerun in by_chance):
        yield f"Within chance, yet new: {within} episodes that did not fail before."
    if verdicts.GateVerdict.UNPROVEN in report.counts:
        yield (
            "Unproven: they fail, but whether the baseline's planner did under the same noise is"
            " not known; gate the baseline's version without --baseline to know it next time."
        )
    if report.open and report.gate.baseline and verdicts.STRICTLY_CLOSING & report.counts.keys():
        yield "Failures that were there before do not close the gate without --strict."
    yield from (note for member in report.members for note in list_notes(member))


def _describe_false_alarms(by_rate: Sequence[Rerun]) -> str:
    """Return how often campaigns judged by rate are called new although nothing changed."""
    share = 100.0 * (1.0 - prod(1.0 - _bound_false_alarm(rerun) for rerun in by_rate))
    none = sum(not rerun.before.failures for rerun in by_rate)
    first = f" (the baseline found none in {none}: {FIRST_FAILURE})" if none else ""
    failing = [rerun for rerun in by_rate if rerun.before.failures]
    by_modes = " or by one of its modes" if any(each.judges_modes for each in failing) else ""
    oftener = OFTENER if any(each.unpaired_because for each in failing) else ""
    return (
        f"{len(by_rate)} judged by rate: even if failures became no likelier, one of them or more"
        f" is called new, by its rate{by_modes}, in up to about {share:.1f} % of"
        f" pairs of runs{first}{oftener}."
    )


def _bound_false_alarm(rerun: Rerun) -> float:
    """Return an upper bound on how often such a campaign is called new by chance."""
    if rerun.before.failures:
        return RISEN + NEW_MODE * rerun.judges_modes
    return FIRST if rerun.unpaired_because else FIRST_OF_PAIRS


def list_notes(member: MemberReport) -> Iterator[str]:
    """Yield each step that could not be done, and each warning, with the member's name."""
    yield from (f"{member.member}: {note}" for note in member.notes)
    if member.rerun:
        yield from (f"{member.member}: {warning}" for warning in member.rerun.warnings)
