"""What a gate says of all of it, and what it cannot say, in sentences."""

from collections.abc import Iterator, Sequence
from math import prod

from eigenfail.gate.found import By, Rerun
from eigenfail.gate.modes import NEW_MODE
from eigenfail.gate.report import GateReport, MemberReport
from eigenfail.gate.verdicts import STRICTLY_CLOSING, Verdict

RISEN = 0.025
"""How often a rate that did not rise is taken for one that did, at most: one side of 95 %."""

FIRST = 0.25
"""How often there is no failure in a campaign and one in the next, at most: with q the probability
of none, q (1 - q)."""

FIRST_OF_PAIRS = 0.5
"""The same where only pairs in which one side failed matter: of a single one, each side's turn."""

OFTENER = "; failures of a search follow each other, so that it may be more often there"


def conclusions(report: GateReport) -> Iterator[str]:
    """What the gate says of all of it, and what it cannot say."""
    yield conclusion(report)
    yield from caveats(report)


def conclusion(report: GateReport) -> str:
    """Whether it is open, and why."""
    counts = ", ".join(f"{count} {each}" for each, count in report.counts.items())
    told = counts or "no failure on either side"
    gate = report.gate
    if not gate.baseline:
        return f"{gate.run} can be a baseline (--baseline {gate.version}): {found(report)}."
    state = "open" if report.open else "closed"
    return f"The gate of {gate.run} against {gate.baseline} is {state}: {told}."


def found(report: GateReport) -> str:
    """What a baseline knows."""
    seen = [member.baseline for member in report.members if member.baseline]
    failures, completed = (
        sum(getattr(each, name) for each in seen) for name in ("failures", "completed")
    )
    counts = ", ".join(f"{count} {each}" for each, count in report.counts.items())
    told = f"; of its known failures, replayed: {counts}" if counts else ""
    return f"{failures} of {completed} episodes fail{told}"


def caveats(report: GateReport) -> Iterator[str]:
    """What an open or a closed gate does not mean."""
    reruns = [each.rerun for each in report.members if each.rerun]
    if by_rate := [rerun for rerun in reruns if rerun.by is By.RATE]:
        yield false_alarms(by_rate)
    if told := sum(len(rerun.new_modes) for rerun in reruns if not rerun.judges_modes):
        yield (
            f"Told, not judged: failure modes of searches that only {report.gate.version} has:"
            f" {told}. Replay them; whether they come back, the same search from other seeds says."
        )
    if within := sum(within_chance(member) for member in report.members):
        yield f"Within chance, yet new: {within} episodes that did not fail before."
    if Verdict.UNPROVEN in report.counts:
        yield (
            "Unproven: they fail, but whether the baseline's planner did under the same noise is"
            " not known; gate the baseline's version without --baseline to know it next time."
        )
    if report.open and report.gate.baseline and STRICTLY_CLOSING & report.counts.keys():
        yield "Failures that were there before do not close the gate without --strict."
    yield from (note for member in report.members for note in notes(member))


def false_alarms(by_rate: Sequence[Rerun]) -> str:
    """How often campaigns that are judged by rate are called new though nothing changed."""
    share = 100.0 * (1.0 - prod(1.0 - false_alarm(rerun) for rerun in by_rate))
    none = sum(not rerun.before.failures for rerun in by_rate)
    first = f" (the baseline found none in {none}: there one failure will do)" if none else ""
    failing = [rerun for rerun in by_rate if rerun.before.failures]
    by_modes = " or by one of its modes" if any(each.judges_modes for each in failing) else ""
    oftener = OFTENER if any(each.unpaired_because for each in failing) else ""
    return (
        f"{len(by_rate)} judged by rate: even if failures became no likelier, one of them or more"
        f" is called new, by its rate{by_modes}, in up to about {share:.1f} % of"
        f" runs{first}{oftener}."
    )


def false_alarm(rerun: Rerun) -> float:
    """How often a campaign like this is called new though failures became no likelier, at most."""
    if rerun.before.failures:
        return RISEN + NEW_MODE * rerun.judges_modes
    return FIRST if rerun.unpaired_because else FIRST_OF_PAIRS


def within_chance(member: MemberReport) -> int:
    """How many episodes are new of a rerun that is not."""
    rerun = member.rerun
    new = rerun.counts.get(Verdict.NEW, 0) if rerun else 0
    return new if rerun and rerun.verdict is not Verdict.NEW else 0


def notes(member: MemberReport) -> Iterator[str]:
    """What could not be done, and which member it is of."""
    yield from (f"{member.member}: {note}" for note in member.notes)
    if member.rerun:
        yield from (f"{member.member}: {warning}" for warning in member.rerun.warnings)
