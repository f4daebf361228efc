"""Tables of releases: the versions of a planner, and what became of each failure mode."""

from collections.abc import Iterable, Iterator

from eigenfail.presentation.figures import UNKNOWN
from eigenfail.presentation.tables import Block, Cell, Table, count_columns, name_columns
from eigenfail.values.release import (
    ModeSighting,
    Release,
    ReleaseMode,
    ReleaseQuestion,
    ReleaseTable,
)
from eigenfail.values.triage import TriageState

NOT_COMPARED = "not compared"
BASELINE = "in the first version compared"


def tabulate_questions(questions: Iterable[ReleaseQuestion]) -> Table:
    """Return the scenarios in which versions of a planner were tested, one a row."""
    rows = tuple(
        (
            *(each.campaign, each.planner, each.scenario, each.requirements, each.method),
            ", ".join(each.versions),
            each.campaigns,
        )
        for each in questions
    )
    columns = (
        *count_columns("Campaign"),
        *name_columns("Planner", "Scenario", "Requirements", "Method", "Versions"),
        *count_columns("Campaigns"),
    )
    return Table("Releases", columns, rows)


def tabulate_releases(found: ReleaseTable) -> tuple[Block, ...]:
    """Return the versions, their failure modes, and what limits the comparison."""
    return (
        f"{found.planner} in {found.scenario}, {found.requirements}, by {found.method}",
        _tabulate_versions(found.releases),
        _tabulate_modes(found),
        *found.notes,
    )


def _tabulate_versions(releases: Iterable[Release]) -> Table:
    rows = tuple(
        (
            each.version,
            ", ".join(map(str, each.campaigns)),
            each.episodes,
            each.failures,
            format_code(each),
        )
        for each in releases
    )
    columns = (
        *name_columns("Version", "Campaigns"),
        *count_columns("Episodes", "Failures"),
        *name_columns("Code"),
    )
    return Table("Versions", columns, rows)


def format_code(release: Release) -> str:
    """Return the fingerprints of the code of a release as text."""
    codes = (" ".join(code.values()) for code in release.fingerprints)
    return " and ".join(codes) or UNKNOWN


def _tabulate_modes(found: ReleaseTable) -> Table:
    rows = tuple(
        (each.number, name_mode(each), *map(format_sighting, each.sightings))
        for each in found.modes
    )
    titles = (each.version for each in found.releases)
    columns = (*count_columns("Mode"), *name_columns("Name", *titles))
    notes = tuple(_list_undecided(found))
    return Table(found.title, columns, rows, notes)


def name_mode(mode: ReleaseMode) -> str:
    """Return the name of a mode, with the state of its triage unless it is new."""
    return mode.name if mode.state is TriageState.NEW else f"{mode.name} ({mode.state.words})"


def format_sighting(sighting: ModeSighting) -> Cell:
    """Return what became of a mode in a version as text, with its number of failures."""
    failures = f" ({sighting.failures:,})" if sighting.failures else ""
    return f"{format_status(sighting)}{failures}"


def format_status(sighting: ModeSighting) -> str:
    """Return what became of a mode in a version as text."""
    if sighting.status is None:
        return NOT_COMPARED if sighting.words else UNKNOWN
    return BASELINE if sighting.is_baseline else sighting.status


def _list_undecided(found: ReleaseTable) -> Iterator[str]:
    if any(one.status == "undecided" for each in found.modes for one in each.sightings):
        yield (
            "Undecided: so few failures or episodes may differ by chance, a search chose the "
            "episodes, or code and settings are the same as before."
        )
