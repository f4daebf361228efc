"""Tables of releases: the versions of a planner, and the status of each failure mode."""

from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

from eigenfail.presentation import tables
from eigenfail.presentation.figures import UNKNOWN, count_noun
from eigenfail.values.release import (
    ModeSighting,
    ModeStatus,
    Release,
    ReleaseMode,
    ReleaseQuestion,
    ReleaseTable,
)
from eigenfail.values.triage import TriageState

NOT_COMPARED = "not compared"
BASELINE = "in the first version compared"


def tabulate_questions(questions: Iterable[ReleaseQuestion]) -> tables.Table:
    """Return the scenarios that versions of a planner were tested in, one a row."""
    return tables.tabulate(
        "Releases",
        questions,
        tables.read_number("Campaign", "campaign"),
        tables.read_text("Planner", "planner"),
        tables.read_text("Scenario", "scenario"),
        tables.read_text("Requirements", "requirements"),
        tables.read_text("Method", "method"),
        tables.read_text("Versions", lambda each: ", ".join(each.versions)),
        tables.read_number("Campaigns", "campaigns"),
    )


def tabulate_releases(found: ReleaseTable) -> tuple[tables.Block, ...]:
    """Return the versions, their failure modes, and the limits of the comparison."""
    asked = found.question
    return (
        f"{asked.planner} in {asked.scenario}, {asked.requirements}, by {asked.method}",
        *([compare_newest(found).words] if len(found.releases) > 1 else []),
        _tabulate_versions(found.releases),
        _tabulate_modes(found),
        *found.notes,
    )


CHANGES: Mapping[ModeStatus, str] = {
    ModeStatus.FIRST_SEEN: "new",
    ModeStatus.REGRESSED: "regressed",
    ModeStatus.STILL_THERE: "still there",
    ModeStatus.NOT_FOUND_AGAIN: "fixed",
    ModeStatus.NOT_MET: "not met",
    ModeStatus.UNDECIDED: "undecided",
}
"""What a status says of the newest version, in the order of lists."""


class NewestComparison(NamedTuple):
    """The newest version against the one before it.

    Attributes:
        version: the newest version.
        before: newest earlier version whose failure modes are compared; empty without one.
        modes: failure modes of either version, by their status in the newest version.
        words: sentences on earlier versions that are left out, with the reason, and on the number
            of modes by status, or on why nothing is compared.
    """

    version: str
    before: str
    modes: Mapping[ModeStatus, tuple[ReleaseMode, ...]]
    words: str


def compare_newest(table: ReleaseTable) -> NewestComparison:
    """Compare the failure modes of the newest version with the version before it.

    A mode that neither of the two versions has is left out.
    """
    *earlier, newest = table.releases
    # Not simply the version before: if that one cannot be compared, the one before it says more
    # than nothing.
    compared = [each for each in earlier if not each.problem]
    version = newest.version
    if newest.problem:
        return NewestComparison(version, "", {}, f"{version} is not compared. {newest.problem}")
    if not compared:
        words = f"{version} is not compared: no version before it can be."
        reasons = [_describe_left_out(each) for each in earlier]
        return NewestComparison(version, "", {}, " ".join([*reasons, words]))
    before = compared[-1].version
    # In the order of `CHANGES`: what needs attention comes first.
    found: dict[ModeStatus, list[ReleaseMode]] = {each: [] for each in CHANGES}
    for change in table.compare(before, version):
        if change.now.status is not None:
            found[change.now.status].append(change.mode)
    modes = {status: tuple(each) for status, each in found.items() if each}
    counts = ", ".join(f"{len(each)} {CHANGES[status]}" for status, each in modes.items())
    words = f"{version} against {before}: {counts or 'no failure mode in either version'}."
    left_out = [_describe_left_out(each) for each in earlier if each.problem]
    return NewestComparison(version, before, modes, " ".join([*left_out, words]))


def _describe_left_out(release: Release) -> str:
    """Return sentences on a version that is left out: its failures, episodes, and the reason."""
    failures = count_noun(release.failures, "failure")
    episodes = count_noun(release.episodes, "episode")
    return f"{release.version}, with {failures} in {episodes}, is not compared. {release.problem}"


def _tabulate_versions(releases: Iterable[Release]) -> tables.Table:
    return tables.tabulate(
        "Versions",
        releases,
        tables.read_text("Version", "version"),
        tables.read_text("Campaigns", lambda each: ", ".join(map(str, each.campaigns))),
        tables.read_number("Episodes", "episodes"),
        tables.read_number("Failures", "failures"),
        tables.read_text("Code", format_code),
    )


def format_code(release: Release) -> str:
    """Return the fingerprints of the code of a release as text."""
    codes = (" ".join(code.values()) for code in release.fingerprints)
    return " and ".join(codes) or UNKNOWN


def _tabulate_modes(found: ReleaseTable) -> tables.Table:
    rows = tuple(
        (each.number, name_mode(each), *map(format_sighting, each.sightings))
        for each in found.modes
    )
    titles = (each.version for each in found.releases)
    columns = (*tables.count_columns("Mode"), *tables.name_columns("Name", *titles))
    return tables.Table(found.title, columns, rows, tuple(_list_undecided(found)))


def name_mode(mode: ReleaseMode) -> str:
    """Return the name of a mode, with the state of its triage unless it is new."""
    return mode.name if mode.state is TriageState.NEW else f"{mode.name} ({mode.state.words})"


def format_sighting(sighting: ModeSighting) -> tables.Cell:
    """Return the status of a mode in a version as text, with its number of failures."""
    # A count of 0 would repeat what the status says.
    failures = f" ({sighting.failures:,})" if sighting.failures else ""
    return f"{format_status(sighting)}{failures}"


def format_status(sighting: ModeSighting) -> str:
    """Return the status of a mode in a version as text."""
    # Words say why a version is not compared; without them the mode has no place in it.
    if sighting.status is None:
        return NOT_COMPARED if sighting.words else UNKNOWN
    return BASELINE if sighting.is_baseline else sighting.status


def _list_undecided(found: ReleaseTable) -> Iterator[str]:
    if any(one.status == "undecided" for each in found.modes for one in each.sightings):
        yield (
            "Undecided: so few failures or episodes may differ by chance, a search chose the "
            "episodes, or code and settings are the same as before."
        )
