"""Failure modes of two versions, matched as in the comparison of releases: shown, not judged."""

from collections import Counter
from collections.abc import Iterator, Sequence

import msgspec

from eigenfail.gate.reruns import Count, ReportName, ReportSentence
from eigenfail.values.release import ModeSighting, ModeStatus, ReleaseTable

NOT_COMPARED = "not compared"

NOT_MATCHED = "Failure modes are not matched over releases: {}"


class MatchedMode(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A failure mode in two versions.

    Attributes:
        name: name of the mode.
        status: what became of it in the new version, after all versions before it; None where that
            is not known.
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
        """The status in words."""
        return self.status or NOT_COMPARED


def match_versions(table: ReleaseTable, before: str, now: str) -> tuple[MatchedMode, ...]:
    """Return the failure modes that two versions have, the baseline first.

    Args:
        table: the comparison of releases that has both versions.
        before: version of the baseline.
        now: the new version.
    """
    places = [each.version for each in table.releases]
    pair = places.index(before), places.index(now)
    found = []
    for mode in table.modes:
        was, newest = (mode.sightings[place] for place in pair)
        if was.failures or newest.failures:
            matched = MatchedMode(
                name=mode.name,
                status=newest.status,
                before=was.failures,
                now=newest.failures,
                mode=_place_mode(newest if newest.failures else was),
                words=newest.words,
            )
            found.append(matched)
    return tuple(found)


def find_obstacle(table: ReleaseTable, before: str, now: str) -> str:
    """Return why the modes of two versions are not matched; empty where they are."""
    if not before:
        return NOT_MATCHED.format("the baseline names no version of the planner.")
    releases = {each.version: each for each in table.releases}
    if before not in releases:
        return NOT_MATCHED.format("the baseline is of another planner.")
    problems = (releases[version].problem for version in (before, now))
    problem = " ".join(filter(None, problems))
    return NOT_MATCHED.format(problem) if problem else ""


def describe_match(mode: MatchedMode) -> str:
    """Return the numbers of failures of a mode in both versions, and why it has its status."""
    numbers = f"{mode.now:,} failures, {mode.before:,} in the baseline (mode {mode.mode})."
    return f"{numbers} {mode.words}".rstrip()


def count_statuses(modes: Sequence[MatchedMode]) -> Iterator[str]:
    """Yield how many modes have each status, in words."""
    counts = Counter(each.status_word for each in modes)
    yield from (f"{count} {word}" for word, count in counts.items())


def _place_mode(sighting: ModeSighting) -> str:
    return f"{sighting.analysis}/{sighting.mode}"
