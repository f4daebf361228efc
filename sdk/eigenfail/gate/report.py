"""What a gate found, and whether it is open."""

from collections import Counter
from collections.abc import Iterator, Sequence

import msgspec

from eigenfail.gate.found import By, Figures, Finding, Rerun
from eigenfail.gate.verdicts import CLOSING, INFRASTRUCTURE, STRICTLY_CLOSING, Verdict


class MemberReport(msgspec.Struct, frozen=True, kw_only=True):
    """What became of one member of the suite.

    Attributes:
        baseline: its campaign there; None where there is none, so that nothing is judged.
        known: the known failures, replayed.
        rerun: None where the baseline is the version itself.
        notes: what could not be done, in sentences.
    """

    member: str
    baseline: Figures | None = None
    known: tuple[Finding, ...] = ()
    rerun: Rerun | None = None
    notes: tuple[str, ...] = ()

    def verdicts(self) -> Iterator[Verdict]:
        """Of each known failure, and of each failing episode of the rerun or of all of it."""
        yield from (finding.verdict for finding in self.known)
        if self.rerun is not None and self.rerun.by is By.EPISODE:
            yield from Counter(self.rerun.counts).elements()
        if self.rerun is not None and self.rerun.by is By.RATE:
            yield self.rerun.verdict


class Gate(msgspec.Struct, frozen=True, kw_only=True):
    """What was asked of a gate.

    Attributes:
        version: of the planners under test.
        run: the name of this run, which later gates can take as their baseline.
        baseline: as it was named; empty if this run makes one.
        strict: whether failures that were there before close the gate, too.
        by: by what campaigns under the same noise are judged.
    """

    suite: str
    version: str
    run: str
    baseline: str = ""
    strict: bool = False
    by: By = By.EPISODE

    @property
    def closing(self) -> frozenset[Verdict]:
        """What closes it."""
        return STRICTLY_CLOSING if self.strict else CLOSING


class GateReport(msgspec.Struct, frozen=True, kw_only=True):
    """What a gate found.

    Attributes:
        counts: how many known failures, episodes and campaigns there are of each verdict.
        open: whether nothing closes the gate.
    """

    gate: Gate
    open: bool
    counts: dict[Verdict, int]
    members: tuple[MemberReport, ...]

    def problems(self) -> Iterator[str]:
        """Why episodes could not be run."""
        for member in self.members:
            findings = (*member.known, *(member.rerun.findings if member.rerun else ()))
            yield from (each.problem for each in findings if each.verdict is Verdict.CANNOT_RUN)

    @property
    def in_trouble(self) -> bool:
        """Whether nothing but the machinery keeps it closed, so that it says nothing."""
        closing = self.gate.closing & self.counts.keys()
        return closing == {Verdict.CANNOT_RUN} and all(
            problem.startswith(INFRASTRUCTURE) for problem in self.problems()
        )


def report(gate: Gate, members: Sequence[MemberReport]) -> GateReport:
    """Everything together."""
    seen = Counter(verdict for member in members for verdict in member.verdicts())
    counts = {verdict: seen[verdict] for verdict in Verdict if seen[verdict]}
    is_open = gate.closing.isdisjoint(counts)
    return GateReport(gate=gate, open=is_open, counts=counts, members=tuple(members))
