"""Failure modes of two versions, matched as in the comparison of releases: shown, not judged."""

from collections import Counter
from collections.abc import Iterator, Sequence

import msgspec

from eigenfail.gate.reruns import ReportName, ReportSentence
from eigenfail.presentation.releases import CHANGES, NOT_COMPARED
from eigenfail.settings import Count, Ordinal
from eigenfail.values.release import ModeChange, ModeStatus, ReleaseTable


class MatchedMode(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A failure mode in two versions.

    Attributes:
        name: name of the mode.
        status: what became of it in the new version, after all versions before it; None where that
            is not known, as in the first version compared.
        before: number of its failures in the version of the baseline.
        now: number of its failures in the new version.
        mode: its newest place, as ANALYSIS/NUMBER.
        words: why the status is what it is, in a sentence.
    """

    name: ReportSentence
    status: ModeStatus | None
    before: Count
    now: Count
    mode: ReportName
    words: ReportSentence = ""

    @property
    def status_word(self) -> str:
        """What became of the mode in the new version, in the words of the pages of releases."""
        return CHANGES[self.status] if self.status else NOT_COMPARED


class MatchedModes(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The failure modes of two versions in one scenario, over all campaigns of each version.

    Attributes:
        members: members of the suite that test the scenario.
        campaign: campaign of the new version that stands for the comparison of releases.
        modes: the modes of either version, in the order in which they were found.
        problem: why modes are not matched; empty where they are.
    """

    members: tuple[ReportName, ...]
    campaign: Ordinal
    modes: tuple[MatchedMode, ...] = ()
    problem: ReportSentence = ""


def match_versions(
    members: Sequence[str], table: ReleaseTable, before: str, now: str
) -> MatchedModes:
    """Return the failure modes that two versions have, or why they are not matched.

    Args:
        members: members of the suite that test the scenario.
        table: the comparison of releases in the scenario, which has the new version.
        before: version of the baseline; empty if it names none.
        now: the new version.
    """
    problem = _find_problem(table, before, now)
    return MatchedModes(
        members=tuple(members),
        campaign=table.question.campaign,
        modes=() if problem else tuple(map(_match_mode, table.compare(before, now))),
        problem=problem,
    )


def _find_problem(table: ReleaseTable, before: str, now: str) -> str:
    if not before:
        return "The baseline names no version of the planner."
    # Another planner of the same scenario has releases of its own.
    releases = {each.version: each for each in table.releases}
    if before not in releases:
        return f"The releases of this scenario do not have {before}: its planner is another one."
    return " ".join(releases[each].problem for each in (before, now) if releases[each].problem)


def _match_mode(change: ModeChange) -> MatchedMode:
    before, now = change.before, change.now
    # Where the new version has no failure of the mode, its place is that in the baseline.
    place = now if now.failures else before
    return MatchedMode(
        name=change.mode.name,
        # In the first version compared no mode can be new, so that its status says nothing.
        status=None if now.is_baseline else now.status,
        before=before.failures,
        now=now.failures,
        mode=f"{place.analysis}/{place.mode}",
        words=now.words,
    )


def describe_match(mode: MatchedMode) -> str:
    """Return the numbers of failures of a mode in both versions, and why it has its status."""
    numbers = f"{mode.now:,} failures, {mode.before:,} in the baseline (mode {mode.mode})."
    return f"{numbers} {mode.words}".rstrip()


def describe_matched(matched: Sequence[MatchedModes]) -> Iterator[str]:
    """Yield how many modes have each status, and which are not matched, in sentences."""
    statuses = Counter(mode.status_word for each in matched for mode in each.modes)
    if statuses:
        counts = ", ".join(f"{count} {word}" for word, count in statuses.items())
        yield f"Failure modes matched over releases, reported and not judged: {counts}."
    for each in matched:
        if each.problem:
            members = ", ".join(each.members)
            yield f"{members}: failure modes are not matched over releases. {each.problem}"
