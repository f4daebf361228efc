"""What a gate says, in sentences."""

from collections.abc import Iterator, Mapping, Sequence
from math import prod

from eigenfail.gate.report import By, GateReport, MemberReport, Rerun
from eigenfail.gate.verdicts import STRICTLY_CLOSING, Verdict
from eigenfail.values import Campaign, Comparison

RISEN = 0.025
"""How often a rate that did not rise is taken for one that did, at most: one side of 95 %."""

FIRST = 0.25
"""How often there is no failure in a campaign and one in the next, at most: with q the probability
of none, q (1 - q)."""

FIRST_OF_PAIRS = 0.5
"""The same where only pairs in which one side failed matter: of a single one, each side's turn."""

RATE_WORDS = {
    Verdict.NEW: "more than chance explains",
    Verdict.STILL_FAILING: "no more and no less than chance explains",
    Verdict.FIXED: "fewer than chance explains",
    Verdict.SAFE: "none on either side",
    Verdict.CANNOT_RUN: "and some episodes cannot be run, which the baseline ran",
}


def of_pairs(counts: Mapping[Verdict, int], comparison: Comparison) -> str:
    """What became of pairs of episodes."""
    pairs = comparison.pairs
    if pairs is None:
        return comparison.unpaired_because
    named = ", ".join(f"{count} {each}" for each, count in counts.items()) or "no failure"
    return f"{pairs.n} pairs of episodes under the same noise: {named}{mcnemar(comparison)}."


def mcnemar(comparison: Comparison) -> str:
    """What chance says of pairs in which only one side failed."""
    pairs = comparison.pairs
    if pairs is None or not (pairs.only_a or pairs.only_b):
        return ""
    return f" (McNemar's exact test on {pairs.only_a + pairs.only_b}: p = {pairs.p_value:.2g})"


def of_rates(verdict: Verdict, before: Campaign, now: Campaign, comparison: Comparison) -> str:
    """What became of the failures of a campaign as a whole."""
    was, counts = before.counts, now.counts
    shares = f"{counts.failures} of {counts.completed} fail, {was.failures} of {was.completed} did"
    if verdict is Verdict.NEW and not was.failures:
        return f"{shares}: the baseline found none, so whatever is found is new."
    if verdict is Verdict.SAFE and was.failures:
        return f"{shares}: none now, though no fewer than chance explains{interval(comparison)}."
    return f"{shares}: {RATE_WORDS[verdict]}{interval(comparison)}."


def interval(comparison: Comparison) -> str:
    """The difference of the failure rates, with its interval."""
    found = comparison.difference
    if found is None:
        return ""
    value, low, high = (
        100.0 * share for share in (found.value, found.interval.low, found.interval.high)
    )
    return f" (difference {value:+.1f} % [{low:+.1f}, {high:+.1f}])"


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
    return (
        f"{len(by_rate)} judged by rate: even if failures became no likelier, one of them or more"
        f" is called new in up to about {share:.1f} % of runs{first}; a new mode at an equal rate"
        " is not noticed."
    )


def false_alarm(rerun: Rerun) -> float:
    """How often a campaign like this is called new though failures became no likelier, at most."""
    if rerun.before.failures:
        return RISEN
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
