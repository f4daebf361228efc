"""Releases: which campaigns test versions of a planner in one scenario, and their failure modes."""

from collections.abc import Hashable, Iterator, Mapping, Sequence
from functools import lru_cache, partial
from typing import NamedTuple

import msgspec
import numpy as np
from msgspec.structs import replace

from eigenfail.errors import InputError, NotFound
from eigenfail.methods import traits_of
from eigenfail.values import FINAL_STATES, Campaign, CampaignSpec
from eigenfail.values.operations import Versions
from eigenfail.values.records import FailureCourse
from eigenfail.values.release import (
    ModeSighting,
    ModeStatus,
    Release,
    ReleaseMode,
    ReleaseQuestion,
    ReleaseTable,
)
from eigenfail.worlds import describe_requirements, world_of
from eigenfail_services.analysis.behaviour import Origin, read_motion
from eigenfail_services.analysis.mode_matching import (
    ReleaseBehaviours,
    Sighting,
    Sightings,
    match_modes,
)
from eigenfail_services.analysis.mode_regions import ModeBehaviours
from eigenfail_services.campaigns.cache import StoreCache
from eigenfail_services.campaigns.drafts import fill_defaults
from eigenfail_services.store import Store

MOST_CAMPAIGNS = 2_000
"""Newest campaigns with a version that are looked at."""

SAMPLED = 40
"""Failures of a mode whose course is read at most."""

NO_COLLISION = "no collision"


class ModeSource(NamedTuple):
    """A failure mode of an analysis, in the failures of one campaign.

    Attributes:
        analysis: id of the analysis.
        number: number of the mode.
        behaviours: what the ego did in these failures.
    """

    analysis: int
    number: int
    behaviours: ModeBehaviours


class _CampaignModes(NamedTuple):
    step_s: float
    modes: tuple[ModeSource, ...]


_cached = StoreCache[_CampaignModes | None](500)
_cached_matches = StoreCache[tuple[Sightings, ...]](100)


def list_questions(store: Store, project: str | None = None) -> tuple[ReleaseQuestion, ...]:
    """Return the scenarios in which versions of a planner were tested, the newest first.

    Args:
        store: where campaigns are.
        project: project that the campaigns belong to; None: any.
    """
    found: dict[str, list[Campaign]] = {}
    for campaign in _list_campaigns(store):
        if project is None or campaign.spec.project == project:
            found.setdefault(_find_key(campaign.spec), []).append(campaign)
    return tuple(map(_make_question, found.values()))


def make_release_table(store: Store, campaign: int) -> ReleaseTable:
    """Return the versions that were tested as in a campaign, with what became of failure modes.

    Raises:
        NotFound: there is no such campaign, or it does not name the version of its planner.
    """
    key = _find_key(store.campaigns.get(campaign).spec)
    alike = [each for each in _list_campaigns(store) if _find_key(each.spec) == key]
    if campaign not in {each.id for each in alike}:
        raise NotFound(
            f"Campaign {campaign} is part of no release.",
            "Name the version of its planner (`planner_version`), and use a method that finds "
            "failures of its own.",
        )
    versions: dict[str, list[Campaign]] = {}
    for each in reversed(alike):
        versions.setdefault(each.spec.version, []).append(each)
    read = [_read_release(store, version, used) for version, used in versions.items()]
    question = _make_question(alike)
    return ReleaseTable(
        campaign=question.campaign,
        planner=question.planner,
        scenario=question.scenario,
        requirements=question.requirements,
        method=question.method,
        releases=tuple(each.release for each in read),
        modes=tuple(_compare_modes(store, read)),
        notes=tuple(_list_notes(read)),
    )


def find_history(store: Store, analysis: int, mode: int) -> tuple[int, ReleaseMode] | None:
    """Return a mode of an analysis over the releases, with the campaign of its question.

    None where its campaign names no version, or where the mode is not the main one of a release.

    Raises:
        NotFound: no such analysis.
    """
    campaign = store.campaigns.get(store.analyses.get(analysis).campaign)
    if not campaign.spec.version or not traits_of(campaign.spec.method).finds_new:
        return None
    table = make_release_table(store, campaign.id)
    for each in table.modes:
        if any((one.analysis, one.mode) == (analysis, mode) for one in each.sightings):
            return table.campaign, each
    return None


def _list_campaigns(store: Store) -> list[Campaign]:
    """Return the campaigns that find failures of a version, newest first."""
    found = store.campaigns.list_versioned(MOST_CAMPAIGNS)
    return [each for each in found if traits_of(each.spec.method).finds_new]


def _find_key(spec: CampaignSpec) -> str:
    fields = ("method", "planner", "scenario", "scenario_parameters", "simulator", "disturbance")
    asked = CampaignSpec(
        **{name: getattr(spec, name) for name in fields},
        name="-",
        episodes=1,
        requirements=spec.all_requirements,
    )
    return _write_key(msgspec.json.encode(asked, order="deterministic"))


@lru_cache(maxsize=MOST_CAMPAIGNS)
def _write_key(asked: bytes) -> str:
    spec = fill_defaults(msgspec.json.decode(asked, type=CampaignSpec))
    same = replace(spec, settings={}, planner_settings={})
    return msgspec.json.encode(same, order="deterministic").decode()


def _make_question(campaigns: Sequence[Campaign]) -> ReleaseQuestion:
    newest = campaigns[0]
    versions = dict.fromkeys(each.spec.version for each in reversed(campaigns))
    requirements = "; ".join(describe_requirements(newest.spec)) or NO_COLLISION
    return ReleaseQuestion(
        campaign=newest.id,
        planner=newest.spec.planner,
        scenario=newest.spec.scenario,
        requirements=requirements,
        method=newest.spec.method,
        versions=tuple(versions),
        campaigns=len(campaigns),
    )


class _ReadRelease(NamedTuple):
    release: Release
    sources: tuple[ModeSource, ...]
    step_s: float | None
    codes: Mapping[int, tuple[Versions, ...]]


def _read_release(store: Store, version: str, campaigns: Sequence[Campaign]) -> _ReadRelease:
    """Return a release from its campaigns, oldest first."""
    used = _drop_repeated(campaigns)
    codes = {each.id: each.code for each in used}
    fingerprints = [code for of_one in codes.values() for code in of_one]
    found, problems = list[_CampaignModes](), list[str]()
    for campaign in used:
        modes = _read_modes(store, campaign)
        if isinstance(modes, str):
            problems.append(modes)
        elif modes:
            found.append(modes)
    steps = {each.step_s for each in found}
    release = Release(
        version=version,
        campaigns=tuple(each.id for each in used),
        episodes=sum(each.counts.completed for each in used),
        failures=sum(each.counts.failures for each in used),
        is_random=all(traits_of(each.spec.method).draws_from_prior for each in used),
        fingerprints=tuple(
            code for place, code in enumerate(fingerprints) if code not in fingerprints[:place]
        ),
        problem=" ".join(problems),
    )
    sources = tuple(mode for each in found for mode in each.modes)
    return _ReadRelease(release, sources, steps.pop() if len(steps) == 1 else None, codes)


def _drop_repeated(campaigns: Sequence[Campaign]) -> list[Campaign]:
    """Return campaigns without earlier ones of the same seed, which have the same noise."""
    newest: dict[tuple[object, ...], Campaign] = {}
    for each in campaigns:
        place = each.spec.seed, msgspec.json.encode(each.spec.settings, order="deterministic")
        if each.counts.completed or place not in newest:
            newest[place] = each
    return sorted(newest.values(), key=lambda each: each.id)


def _read_modes(store: Store, campaign: Campaign) -> _CampaignModes | str | None:
    """Return the modes of a campaign; None without a failure, and a sentence if there are none."""
    if campaign.state not in FINAL_STATES:
        return f"Campaign {campaign.id} is {campaign.state}."
    if not campaign.counts.failures:
        return None
    if not world_of(campaign.spec.simulator).has_road:
        return "Failures of functions have no behaviour by which modes could be compared."
    analysis = store.analyses.find_newest(campaign.id)
    if analysis is None:
        return f"Campaign {campaign.id} is not analysed: run `eigenfail analyze {campaign.id}`."
    place = analysis, campaign.id
    try:
        found = _cached.get(store, place, None, lambda: _read_behaviours(store, analysis, campaign))
    except InputError as error:
        return f"The scenario of campaign {campaign.id} is not installed here as it was: {error}"
    return found or f"The scenes of the failures of campaign {campaign.id} are not stored."


def _read_behaviours(store: Store, analysis: int, campaign: Campaign) -> _CampaignModes | None:
    from_start = None
    if campaign.spec.named_requirements:
        # These failures need not end in a collision: all their steps count, from the start.
        from_start = world_of(campaign.spec.simulator).horizon(campaign.spec)
    found = store.episodes.mode_courses(analysis, campaign.id, SAMPLED)
    steps_s = {course.dt_s for _, courses in found.values() for course in courses}
    read = {
        number: _make_behaviours(campaign.id, failures, courses, from_start)
        for number, (failures, courses) in found.items()
    }
    if len(steps_s) != 1 or None in read.values():
        return None
    modes = (ModeSource(analysis, number, each) for number, each in read.items() if each)
    return _CampaignModes(steps_s.pop(), tuple(modes))


def _make_behaviours(
    campaign: int, failures: int, courses: Sequence[FailureCourse], from_start: int | None
) -> ModeBehaviours | None:
    origin: Origin = "collision" if from_start is None else "start"
    motion = read_motion([(campaign, course) for course in courses], origin)
    if motion is None:
        return None
    rows = [motion.accelerations[campaign, course.index] for course in courses]
    steps = max(map(len, rows)) if from_start is None else from_start
    accelerations = np.zeros((len(rows), steps), np.float32)
    for line, row in zip(accelerations, rows, strict=True):
        line[slice(steps - len(row), None) if origin == "collision" else slice(len(row))] = row
    contacts = [motion.contacts.get((campaign, course.index)) for course in courses]
    struck = tuple(each.struck for each in contacts if each)
    return ModeBehaviours(accelerations, struck if len(struck) == len(rows) else (), failures)


def _compare_modes(store: Store, read: Sequence[_ReadRelease]) -> Iterator[ReleaseMode]:
    """Yield the modes over all releases; those with a problem say nothing of a mode."""
    compared = [each for each in read if not each.release.problem]
    steps_s = {each.step_s for each in compared if each.step_s is not None}
    if len(steps_s) != 1:
        return
    compare = partial(_match_releases, compared, steps_s.pop())
    matched = _cached_matches.get(store, tuple(map(_identify, compared)), None, compare)
    for number, found in enumerate(matched, start=1):
        told = {
            each.release.version: _make_sighting(each, one)
            for each, one in zip(compared, found, strict=True)
        }
        sightings = tuple(
            told.get(each.release.version)
            or ModeSighting(version=each.release.version, words=each.release.problem)
            for each in read
        )
        yield ReleaseMode(number=number, name=_find_name(store, sightings), sightings=sightings)


def _match_releases(read: Sequence[_ReadRelease], step_s: float) -> tuple[Sightings, ...]:
    behaviours = [
        ReleaseBehaviours(
            each.release.episodes,
            each.release.is_random,
            tuple(source.behaviours for source in each.sources),
            _write_code(each.release),
        )
        for each in read
    ]
    return match_modes(behaviours, step_s)


def _identify(read: _ReadRelease) -> tuple[Hashable, ...]:
    """Return what the comparison of a release follows from: results never change."""
    release = read.release
    modes = tuple((each.analysis, each.number) for each in read.sources)
    return release.campaigns, release.episodes, _write_code(release), modes


def _write_code(release: Release) -> str:
    """Return the code of a release as text; empty where it is not known, or not one."""
    (code,) = release.fingerprints if len(release.fingerprints) == 1 else ({},)
    return msgspec.json.encode(code, order="sorted").decode() if code else ""


def _find_name(store: Store, sightings: Sequence[ModeSighting]) -> str:
    for each in reversed(sightings):
        if each.analysis is not None and each.mode is not None:
            return store.analyses.mode(each.analysis, each.mode).name
    return ""


def _make_sighting(read: _ReadRelease, found: Sighting) -> ModeSighting:
    source = None if found.source is None else read.sources[found.source]
    return ModeSighting(
        version=read.release.version,
        status=found.status,
        failures=found.failures,
        chance=found.chance,
        analysis=source.analysis if source else None,
        mode=source.number if source else None,
        words=_describe(read.release, found),
    )


def _describe(release: Release, found: Sighting) -> str:
    """Return why the status of a mode is what it is."""
    if found.status is None:
        return ""
    counted = f"{found.failures:,} of {release.episodes:,} episodes"
    if not release.is_random and found.status in _DOUBTFUL:
        return f"{counted}; a search chose the episodes, so that this is no proof."
    if found.chance is None:
        return f"{counted}."
    return f"{counted}; the probability of this by chance is {found.chance:.2g}."


_DOUBTFUL = (ModeStatus.NOT_FOUND_AGAIN, ModeStatus.UNDECIDED, ModeStatus.REGRESSED)


def _list_notes(read: Sequence[_ReadRelease]) -> Iterator[str]:
    """Yield what limits the comparison, in sentences."""
    seen: dict[str, str] = {}
    for each in read:
        release = each.release
        if release.problem:
            yield f"The failure modes of {release.version} are not compared. {release.problem}"
        if len(release.fingerprints) > 1:
            yield _describe_codes(each)
        elif code := _write_code(release):
            earlier = seen.setdefault(code, release.version)
            if earlier != release.version:
                yield f"{release.version} has the same code as {earlier}."
    if any(not each.release.is_random for each in read):
        yield (
            "A search chooses its episodes: that it does not find a mode does not prove that the "
            "mode is gone. Replay the failures of the mode with the new version."
        )


def _describe_codes(read: _ReadRelease) -> str:
    """Return in which packages the campaigns of one version had different code."""
    packages = sorted({name for code in read.release.fingerprints for name in code})
    differing = [
        f"{package} " + ", ".join(f"{digest} ({ids})" for digest, ids in by_digest.items())
        for package in packages
        if len(by_digest := _group_campaigns(read, package)) > 1
    ]
    return f"Version {read.release.version} ran with different code: {'; '.join(differing)}."


def _group_campaigns(read: _ReadRelease, package: str) -> dict[str, str]:
    found: dict[str, list[int]] = {}
    for campaign, codes in read.codes.items():
        for digest in dict.fromkeys(code.get(package, "none") for code in codes):
            found.setdefault(digest, []).append(campaign)
    return {
        digest: f"campaign{'s' * (len(ids) > 1)} {', '.join(map(str, ids))}"
        for digest, ids in found.items()
    }
