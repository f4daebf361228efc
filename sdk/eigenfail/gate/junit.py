"""A gate's report as JUnit XML, as Jenkins, GitLab and GitHub read it.

One `testsuite` for each member of the suite, one `testcase` for each known failure, for each
campaign that was run again, and for each of its new failure modes and new failures. What closes
the gate is a `failure`, what cannot be run an `error`; what was there before, and what cannot be
judged, is `skipped`.
"""

import re
from collections.abc import Iterator
from functools import partial
from typing import NamedTuple
from xml.etree import ElementTree as ET

from eigenfail.gate.found import By, Finding, Rerun
from eigenfail.gate.report import Gate, GateReport, MemberReport
from eigenfail.gate.verdicts import CLOSING, Verdict

ILLEGAL = re.compile("[^\t\n\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that an XML 1.0 document cannot hold, or does not keep."""

NOT_SAFE = frozenset(Verdict) - {Verdict.SAFE, Verdict.FIXED}


class Case(NamedTuple):
    """A test case: where it stands, what it is called, what became of it, and the details."""

    group: str
    name: str
    verdict: Verdict | None
    details: str
    wall_s: float = 0.0


def to_junit(report: GateReport) -> bytes:
    """The document, encoded as UTF-8."""
    root = ET.Element("testsuites", name=plain(f"eigenfail gate {report.gate.run}"))
    for member in report.members:
        root.append(suite_of(member, report.gate))
    total(root, list(root.iter("testcase")))
    ET.indent(root)
    document: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return document + b"\n"


def suite_of(member: MemberReport, gate: Gate) -> ET.Element:
    """The test suite of a member."""
    suite = ET.Element("testsuite", name=plain(f"{gate.suite}: {member.member}"))
    properties = ET.SubElement(suite, "properties")
    for name, value in facts(member, gate):
        ET.SubElement(properties, "property", name=name, value=plain(value))
    found = [element(case, suite.get("name", ""), gate) for case in cases(member)]
    suite.extend(found)
    total(suite, found)
    return suite


def facts(member: MemberReport, gate: Gate) -> Iterator[tuple[str, str]]:
    """What the member's verdicts rest on, by name."""
    yield "version", gate.version
    yield "baseline", gate.baseline
    if member.baseline is not None:
        yield "baseline campaign", str(member.baseline.campaign)
    if rerun := member.rerun:
        yield "campaign", str(rerun.now.campaign)
        yield "failures", f"{rerun.now.failures} of {rerun.now.completed}"
        yield "failures before", f"{rerun.before.failures} of {rerun.before.completed}"
        yield from ((str(each), str(count)) for each, count in rerun.counts.items())


def cases(member: MemberReport) -> Iterator[Case]:
    """The test cases of a member."""
    for note in member.notes:
        yield Case("baseline", note, None, note)
    for known in member.known:
        yield Case("known failures", known.what, known.verdict, details(known), known.wall_s)
    if rerun := member.rerun:
        yield Case(
            "rerun", f"campaign {rerun.before.campaign}", rerun.verdict, whole(rerun), rerun.wall_s
        )
        yield from map(partial(of_mode, rerun), rerun.new_modes)
        for each in rerun.findings:
            if rerun.by is By.EPISODE and each.verdict in CLOSING:
                yield Case("rerun", each.what, each.verdict, details(each), each.wall_s)


def of_mode(rerun: Rerun, found: Finding) -> Case:
    """A failure mode that is new: judged only where it counts."""
    verdict = found.verdict if rerun.judges_modes else None
    told = f"{details(found)}\n{rerun.modes}"
    return Case("new modes", found.what, verdict, told, found.wall_s)


def whole(rerun: Rerun) -> str:
    """The rerun in words, with the replays of what was found."""
    return "\n".join([rerun.told, *(f"{each.what}: {details(each)}" for each in rerun.findings)])


def details(finding: Finding) -> str:
    """How to see it."""
    return "\n".join(filter(None, (finding.problem, finding.replay, finding.link)))


def element(case: Case, suite: str, gate: Gate) -> ET.Element:
    """A test case with what became of it."""
    found = ET.Element("testcase", classname=plain(f"{suite}.{case.group}"), name=plain(case.name))
    found.set("time", f"{case.wall_s:.3f}")
    message = case.verdict or "not judged"
    if tag := tag_of(case.verdict, gate):
        ET.SubElement(found, tag, message=message, type=message).text = plain(case.details)
    else:
        ET.SubElement(found, "system-out").text = plain(f"{message}\n{case.details}")
    return found


def tag_of(verdict: Verdict | None, gate: Gate) -> str:
    """The element that says what became of a case; empty for one that passed."""
    if verdict is Verdict.CANNOT_RUN:
        return "error"
    if verdict in gate.closing:
        return "failure"
    return "skipped" if verdict is None or verdict in NOT_SAFE else ""


def total(group: ET.Element, found: list[ET.Element]) -> None:
    """Write how many cases a group has, and how they ended."""
    tags = {"failures": "failure", "errors": "error", "skipped": "skipped"}
    group.set("tests", str(len(found)))
    for name, tag in tags.items():
        group.set(name, str(sum(each.find(tag) is not None for each in found)))
    group.set("time", f"{sum(float(each.get('time', '0')) for each in found):.3f}")


def plain(text: str) -> str:
    """The text without characters that XML cannot hold."""
    return ILLEGAL.sub("", text)
