"""Releases: campaigns that test versions of a planner in one scenario, and their failure modes."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import islice
from typing import NamedTuple

from msgspec.structs import replace

from eigenfail.errors import NotFound
from eigenfail.methods import traits_of
from eigenfail.presentation.figures import format_number, format_upper_bound, round_up
from eigenfail.presentation.rates import format_rate
from eigenfail.values import release
from eigenfail.values.analysis import Mode
from eigenfail.values.campaign import Campaign
from eigenfail.values.triage import TriageState
from eigenfail.worlds import describe_requirements
from eigenfail_services.analysis import mode_matching
from eigenfail_services.comparison import release_reading
from eigenfail_services.comparison.comparability import write_release_question
from eigenfail_services.store.store import Store

NO_COLLISION = "no collision"

NO_PROOF = "Not met in this search; this is no proof: replay its failures."

CHOSEN = "A search chose the episodes, so that this is no proof."

FIXED_YET_THERE = (
    "Mode {mode.number}, {mode.name}, is marked {words} (analysis {fixed.analysis}, mode "
    "{fixed.mode}), and {version} has failures of it."
)

DIGITS = 2
"""Significant digits of a probability."""


def list_tested_worlds(
    store: Store, project: str | None = None
) -> tuple[release.ReleaseQuestion, ...]:
    """Return the scenarios with tests of planner versions, the newest first.

    Args:
        store: store of the campaigns.
        project: project that the campaigns belong to; None: any.
    """
    return tuple(map(_make_question, _group_campaigns(_list_campaigns(store).items, project)))


def list_release_tables(
    store: Store, project: str | None, limit: int
) -> tuple[release.ReleaseTable, ...]:
    """Return the newest scenarios with tests of several versions, each with all its versions.

    Args:
        store: store of the campaigns.
        project: project that the campaigns belong to; None: any.
        limit: maximum number of scenarios.
    """
    read = _list_campaigns(store)
    found = (
        each
        for each in _group_campaigns(read.items, project)
        if any(one.spec.version != each[0].spec.version for one in each)
    )
    return tuple(_make_table(store, each, read.notes) for each in islice(found, limit))


def _group_campaigns(campaigns: Sequence[Campaign], project: str | None) -> list[list[Campaign]]:
    """Group campaigns by their question, the newest first."""
    found: dict[str, list[Campaign]] = {}
    for campaign in campaigns:
        if project is None or campaign.spec.project == project:
            found.setdefault(write_release_question(campaign.spec), []).append(campaign)
    return [*found.values()]


def make_release_table(store: Store, campaign: int) -> release.ReleaseTable:
    """Return the versions with the same question as a campaign, and the fate of failure modes.

    Raises:
        NotFound: the campaign does not exist, or is not one of the newest campaigns that find
            failures of a version.
    """
    key = write_release_question(store.campaigns.get(campaign).spec)
    read = _list_campaigns(store)
    alike = [each for each in read.items if write_release_question(each.spec) == key]
    if campaign not in {each.id for each in alike}:
        raise NotFound(
            f"Campaign {campaign} is part of no release.",
            "Name the version of its planner (`planner_version`), and use a method that finds "
            "failures of its own.",
        )
    return _make_table(store, alike, read.notes)


def _make_table(
    store: Store, alike: Sequence[Campaign], read_notes: tuple[str, ...]
) -> release.ReleaseTable:
    """Return the versions of campaigns that ask the same question.

    Args:
        store: store with analyses and episodes.
        alike: the campaigns, newest first.
        read_notes: sentences on campaigns that were not read.
    """
    versions: dict[str, list[Campaign]] = {}
    # Oldest first: versions have the order of their first campaigns.
    for each in reversed(alike):
        versions.setdefault(each.spec.version, []).append(each)
    read = [
        release_reading.read_release(store, version, used) for version, used in versions.items()
    ]
    known = _read_modes(store, read)
    # Names and triage are read now and not cached with the comparison: users change them at any
    # time.
    modes = tuple(_name_modes(_compare_modes(store, read), known))
    return release.ReleaseTable(
        question=_make_question(alike),
        releases=tuple(each.release for each in read),
        modes=modes,
        notes=(*release_reading.list_notes(read), *_list_fixed(modes, known), *read_notes),
    )


def find_history(store: Store, analysis: int, mode: int) -> tuple[int, release.ReleaseMode] | None:
    """Return a mode of an analysis over the releases, with the campaign of its question.

    None if its campaign names no version, or if the mode is not the main one of a release.

    Raises:
        NotFound: no such analysis.
    """
    campaign = store.campaigns.get(store.analyses.get(analysis).campaign)
    if not campaign.spec.version or not traits_of(campaign.spec.method).finds_new:
        return None
    table = make_release_table(store, campaign.id)
    for each in table.modes:
        if any((one.analysis, one.mode) == (analysis, mode) for one in each.sightings):
            return table.question.campaign, each
    return None


class _VersionedCampaigns(NamedTuple):
    """Campaigns that find failures of a version, newest first, and a note if some are missing."""

    items: tuple[Campaign, ...]
    notes: tuple[str, ...]


def _list_campaigns(store: Store) -> _VersionedCampaigns:
    """Return the newest campaigns that find failures of a version."""
    # One campaign more than is used shows whether older ones were left out.
    found = store.campaigns.list_versioned(release_reading.MOST_CAMPAIGNS + 1)
    cut = (
        f"Only the newest {release_reading.MOST_CAMPAIGNS:,} campaigns with a version are read: "
        "older versions may be missing."
    )
    return _VersionedCampaigns(
        tuple(
            each
            for each in found[: release_reading.MOST_CAMPAIGNS]
            if traits_of(each.spec.method).finds_new
        ),
        (cut,) if len(found) > release_reading.MOST_CAMPAIGNS else (),
    )


def _make_question(campaigns: Sequence[Campaign]) -> release.ReleaseQuestion:
    newest = campaigns[0]
    versions = dict.fromkeys(each.spec.version for each in reversed(campaigns))
    requirements = "; ".join(describe_requirements(newest.spec)) or NO_COLLISION
    return release.ReleaseQuestion(
        campaign=newest.id,
        planner=newest.spec.planner,
        scenario=newest.spec.scenario,
        requirements=requirements,
        method=newest.spec.method,
        versions=tuple(versions),
        campaigns=len(campaigns),
    )


def _compare_modes(
    store: Store, read: Sequence[release_reading.ReadRelease]
) -> tuple[release.ReleaseMode, ...]:
    """Return the modes over all releases; releases with a problem are not compared."""
    compared = [each for each in read if not each.release.problem]
    # Accelerations over steps of different length are no points of one space.
    steps_s = {each.step_s for each in compared if each.step_s is not None}
    if len(steps_s) != 1:
        return ()
    compare = partial(_match_releases, compared, steps_s.pop())
    question = ("modes of releases", *(each.identity for each in compared))
    matched = store.answers.get(question, None, compare)
    return tuple(
        release.ReleaseMode(
            number=number, name="", sightings=tuple(_list_sightings(read, compared, found))
        )
        for number, found in enumerate(matched, start=1)
    )


def _match_releases(
    read: Sequence[release_reading.ReadRelease], step_s: float
) -> tuple[mode_matching.Sightings, ...]:
    behaviours = [
        mode_matching.ReleaseBehaviours(
            each.release.episodes,
            each.release.is_random,
            tuple(source.behaviours for source in each.sources),
            each.build,
            each.noise,
        )
        for each in read
    ]
    return mode_matching.match_modes(behaviours, step_s)


def _list_sightings(
    read: Sequence[release_reading.ReadRelease],
    compared: Sequence[release_reading.ReadRelease],
    found: mode_matching.Sightings,
) -> Iterator[release.ModeSighting]:
    """Yield the fate of a mode in each release, including releases that are not compared."""
    left = iter(found)
    skipped: list[str] = []
    for each in read:
        if each.release.problem:
            skipped.append(each.release.version)
            yield release.ModeSighting(version=each.release.version, words=each.release.problem)
            continue
        sighting = _make_sighting(each, next(left), compared)
        if skipped and sighting.status is not None:
            # What became of the mode there is not known: the status passes over it.
            words = f"{sighting.words} Not compared: {', '.join(skipped)}.".lstrip()
            sighting = replace(sighting, words=words)
        yield sighting


def _make_sighting(
    read: release_reading.ReadRelease,
    found: mode_matching.Sighting,
    compared: Sequence[release_reading.ReadRelease],
) -> release.ModeSighting:
    source = None if found.source is None else read.sources[found.source]
    return release.ModeSighting(
        version=read.release.version,
        status=found.status,
        failures=found.failures,
        chance=found.chance if read.release.is_random else None,
        analysis=source.analysis if source else None,
        mode=source.number if source else None,
        words=_describe_sighting(read, found, compared),
    )


def _describe_sighting(
    read: release_reading.ReadRelease,
    found: mode_matching.Sighting,
    compared: Sequence[release_reading.ReadRelease],
) -> str:
    """Return the reason for the status of a mode; empty before the mode was found.

    Args:
        read: the release.
        found: fate of the mode in the release.
        compared: all releases that are compared, as `Sighting.same_as` counts them.
    """
    if found.status is None:
        return ""
    counted = _count(read, found.failures)
    if found.same_as is not None:
        earlier = compared[found.same_as].release.version
        return f"{counted}; the same code and settings as {earlier}."
    if found.status is release.ModeStatus.NOT_MET:
        return f"{counted}. {NO_PROOF}"
    if not read.release.is_random:
        is_open = found.status is release.ModeStatus.UNDECIDED
        return f"{counted}. {CHOSEN}" if is_open else f"{counted}."
    return f"{counted}{_describe_test(found.chance)}"


def _count(read: release_reading.ReadRelease, failures: int) -> str:
    """Return the number of failures, with its rate if the episodes are a random sample."""
    found = read.release
    if not found.failures:
        return f"No failure in {found.episodes:,} episodes" + _bound_rate(read)
    if found.analysed < found.failures:
        analysed = f"{failures:,} of the {found.analysed:,} failures analysed"
        return f"{analysed}; {found.failures:,} were found"
    if not found.is_random:
        return f"{failures:,} of the {found.failures:,} failures"
    if not failures:
        return f"0 of {found.episodes:,} episodes{_bound_rate(read)}"
    rate = read.make_rate(failures)
    return f"{failures:,} of {found.episodes:,} episodes: {format_rate(rate)}"


def _bound_rate(read: release_reading.ReadRelease) -> str:
    """Return the upper bound of the failure rate of a release without failures, as text."""
    if not read.release.episodes:
        return ""
    interval = read.make_rate(0).interval
    return f": {format_upper_bound(interval.high)}" if interval else ""


def _describe_test(chance: float | None) -> str:
    """Return the end of a sentence: what a test of the numbers of failures found."""
    if chance is None:
        return "."
    bound = format_number(min(1.0, round_up(chance, DIGITS)), DIGITS)
    test = (
        "if its rate were unchanged, a count this uneven would have a probability of at most "
        f"{bound}."
    )
    if chance <= mode_matching.LEVEL:
        return f"; {test}"
    return "; chance may explain it." if chance >= 1.0 else f"; chance may explain it: {test}"


_ModesByPlace = Mapping[tuple[int | None, int | None], Mode]


def _read_modes(store: Store, read: Sequence[release_reading.ReadRelease]) -> _ModesByPlace:
    """Return the modes of all analyses of releases, with their present triage and names."""
    analyses = dict.fromkeys(source.analysis for each in read for source in each.sources)
    return {
        (mode.analysis, mode.number): mode
        for analysis in analyses
        for mode in store.analyses.modes(analysis)
    }


def _name_modes(
    modes: Sequence[release.ReleaseMode], known: _ModesByPlace
) -> Iterator[release.ReleaseMode]:
    """Yield modes with names and triage of their newest sightings."""
    # A mode that is gone keeps the name that it had in the last version with failures of it.
    newest = [
        next(
            known[one.analysis, one.mode]
            for one in reversed(each.sightings)
            if one.analysis is not None
        )
        for each in modes
    ]
    counts = Counter(each.name for each in newest)
    for mode, each in zip(modes, newest, strict=True):
        address = f" (analysis {each.analysis}, mode {each.number})"
        name = f"{each.name}{address}" if counts[each.name] > 1 else each.name
        yield replace(mode, name=name, state=each.state)


def _list_fixed(modes: Sequence[release.ReleaseMode], known: _ModesByPlace) -> Iterator[str]:
    """Yield sentences on modes that are marked fixed but still occur."""
    for mode in modes:
        # Only the newest sighting that is marked fixed counts: one warning about a mode is enough.
        for one in reversed(mode.sightings):
            place = one.analysis, one.mode
            if place in known and known[place].state is TriageState.FIXED:
                compared = [each for each in mode.sightings if each.status is not None]
                if compared[-1].failures:
                    yield FIXED_YET_THERE.format(
                        mode=mode,
                        words=TriageState.FIXED.words,
                        fixed=one,
                        version=compared[-1].version,
                    )
                break
