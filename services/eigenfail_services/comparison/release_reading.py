"""Reading of releases: campaigns of a version, its code and settings, and its modes."""

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import msgspec
import numpy as np

from eigenfail.methods import traits_of
from eigenfail.values.analysis import AnalysisResult
from eigenfail.values.campaign import FINAL_STATES, Campaign
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.estimates import Rate
from eigenfail.values.operations import Versions
from eigenfail.values.records import FailureCourse
from eigenfail.values.release import Release
from eigenfail.worlds import world_of
from eigenfail_services.analysis.behaviour import Origin, read_motion
from eigenfail_services.analysis.mode_regions import ModeBehaviours
from eigenfail_services.analysis.sampling_design import SamplingDesign
from eigenfail_services.campaigns.summary import count_unresolved
from eigenfail_services.comparison.comparability import flatten_spec
from eigenfail_services.store.retention import UNFINISHED
from eigenfail_services.store.store import Store

MOST_CAMPAIGNS = 2_000
"""Newest campaigns with a version that are looked at."""

SAMPLED = 40
"""Failures of a mode whose course is read at most."""

NEWEST_ANALYSES = 20
"""Newest analyses of a campaign among which one that has not ended is looked for."""

PLANNER = "planner_settings."

PlannerSettings = Mapping[str, str]
"""Settings of a planner with their defaults, as text by dotted path."""


class ModeSource(NamedTuple):
    """A failure mode of an analysis, in the failures of one campaign.

    Attributes:
        analysis: id of the analysis.
        number: number of the mode.
        behaviours: behaviours of the ego in the mode's failures.
    """

    analysis: int
    number: int
    behaviours: ModeBehaviours


class _CampaignModes(NamedTuple):
    analysis: int
    is_distinct: bool
    is_snapshot: bool
    step_s: float
    modes: tuple[ModeSource, ...]


class ReadRelease(NamedTuple):
    """A release with the facts for its comparison.

    Attributes:
        release: the release.
        sources: the failure modes of its analyses.
        step_s: duration of a step; None without a mode, or if steps differ. [s]
        codes: code that ran the episodes of each campaign, by id of the campaign.
        settings: settings of the planner of each campaign, by id of the campaign.
        design: sampling design of its episodes, which decides what numbers of failures can show.
        groups: analyses whose modes are not distinct.
        noise: seeds and settings of its campaigns as text; equal texts mean equal noise.
        errored: number of its episodes that errored.
        unresolved: number of its episodes that are unresolved.
    """

    release: Release
    sources: tuple[ModeSource, ...]
    step_s: float | None
    codes: Mapping[int, tuple[Versions, ...]]
    settings: Mapping[int, PlannerSettings]
    design: SamplingDesign
    groups: tuple[int, ...]
    noise: str
    errored: int
    unresolved: int

    def make_rate(self, failures: int) -> Rate:
        """Return the rate of some failures; errored and unresolved episodes may hide more."""
        counts = self.release.episodes, self.errored, self.unresolved
        return self.design.make_rate(failures, *counts)

    @property
    def identity(self) -> tuple[Hashable, ...]:
        """Return the facts on which the comparison of the release depends; results never change."""
        modes = tuple((each.analysis, each.number) for each in self.sources)
        return self.release.campaigns, self.release.episodes, self.build, modes

    @property
    def code(self) -> str:
        """Return the code of the release as text; empty if it is unknown or differs."""
        (code,) = self.release.fingerprints if len(self.release.fingerprints) == 1 else ({},)
        return msgspec.json.encode(code, order="sorted").decode() if code else ""

    @property
    def build(self) -> str:
        """Return code and settings as text; empty if they are unknown or differ."""
        texts = {msgspec.json.encode(each, order="sorted") for each in self.settings.values()}
        return f"{self.code} {texts.pop().decode()}" if self.code and len(texts) == 1 else ""


def read_release(store: Store, version: str, campaigns: Sequence[Campaign]) -> ReadRelease:
    """Return a release from its campaigns.

    Args:
        store: store with analyses and episodes.
        version: the version.
        campaigns: the campaigns of the version that ask one question, oldest first.
    """
    used = _drop_repeated(campaigns)
    codes = {each.id: each.code for each in used}
    found, problems = list[_CampaignModes](), list[str]()
    for campaign in used:
        modes = _read_modes(store, campaign)
        if isinstance(modes, str):
            problems.append(modes)
        elif modes:
            found.append(modes)
    steps = {each.step_s for each in found}
    sources = tuple(mode for each in found for mode in each.modes)
    release = Release(
        version=version,
        campaigns=tuple(each.id for each in used),
        episodes=sum(each.counts.completed for each in used),
        failures=sum(each.counts.failures for each in used),
        analysed=sum(each.behaviours.failures for each in sources),
        # Campaigns that ask one question have one method.
        is_random=traits_of(used[0].spec.method).draws_from_prior,
        is_distinct=all(each.is_distinct for each in found),
        fingerprints=_list_different(code for of_one in codes.values() for code in of_one),
        problem=" ".join(problems),
    )
    return ReadRelease(
        release=release,
        sources=sources,
        step_s=steps.pop() if len(steps) == 1 else None,
        codes=codes,
        settings={each.id: _read_settings(each.spec) for each in used},
        design=SamplingDesign.of([each.spec for each in used]),
        groups=tuple(dict.fromkeys(each.analysis for each in found if not each.is_distinct)),
        noise=_write_noise(used),
        errored=sum(each.counts.errored for each in used),
        unresolved=sum(count_unresolved(store, each) for each in used),
    )


def _write_noise(campaigns: Sequence[Campaign]) -> str:
    """Return seeds and settings of the method as text; equal texts mean equal noise."""
    drawn = sorted(
        (each.spec.seed, msgspec.json.encode(each.spec.settings, order="deterministic").decode())
        for each in campaigns
    )
    return msgspec.json.encode(drawn).decode()


def _list_different(codes: Iterable[Versions]) -> tuple[Versions, ...]:
    found = list[Versions]()
    for code in codes:
        if code not in found:
            found.append(code)
    return tuple(found)


def _read_settings(spec: CampaignSpec) -> PlannerSettings:
    flat = flatten_spec(spec)
    return {
        path.removeprefix(PLANNER): value
        for path, value in flat.items()
        if path.startswith(PLANNER)
    }


def _drop_repeated(campaigns: Sequence[Campaign]) -> list[Campaign]:
    """Return one campaign for each seed and settings: the newest with results, if any has some."""
    newest: dict[tuple[object, ...], Campaign] = {}
    for each in campaigns:
        place = each.spec.seed, msgspec.json.encode(each.spec.settings, order="deterministic")
        # A repetition that has completed nothing must not replace a campaign with results.
        if each.counts.completed or place not in newest:
            newest[place] = each
    return sorted(newest.values(), key=lambda each: each.id)


def _read_modes(store: Store, campaign: Campaign) -> _CampaignModes | str | None:
    """Return a campaign's modes, or a sentence if there are none; None without a failure."""
    if obstacle := _find_obstacle(campaign):
        return obstacle
    if not campaign.counts.failures:
        return None
    analysis = store.analyses.find_newest(campaign.id)
    if analysis is None:
        return f"Campaign {campaign.id} is not analysed{_describe_next(store, campaign.id)}"
    # A finished analysis never changes, so the cache needs no state.
    question = ("modes of a campaign", analysis, campaign.id)
    found = store.answers.get(question, None, lambda: _read_behaviours(store, analysis, campaign))
    if found is None:
        return f"The scenes of the failures of campaign {campaign.id} are not stored."
    return _describe_snapshot(store, campaign, found) or found


def _find_obstacle(campaign: Campaign) -> str:
    if campaign.state not in FINAL_STATES:
        return f"Campaign {campaign.id} is {campaign.state}."
    if not campaign.counts.completed:
        # Without this, "no failure" of no episode would read as a version without failures.
        return f"Campaign {campaign.id} completed no episode."
    if campaign.counts.failures and not world_of(campaign.spec.simulator).has_road:
        return "Failures of functions have no behaviour by which modes could be compared."
    # Failures without a collision are compared over whole episodes, whose length must be known.
    if not (campaign.form.steps or campaign.spec.fails_by_collision_alone):
        return f"The scenario of campaign {campaign.id} was not known when it was created."
    return ""


def _describe_snapshot(store: Store, campaign: Campaign, found: _CampaignModes) -> str:
    """Return the remark that an analysis lacks later failures; empty if it has all failures."""
    if not found.is_snapshot:
        return ""
    begun = f"Analysis {found.analysis} was made while campaign {campaign.id} was running"
    return f"{begun}{_describe_next(store, campaign.id)}"


def _describe_next(store: Store, campaign: int) -> str:
    """Return the end of a sentence: which analysis is coming, or how to begin one."""
    newest = store.analyses.page(NEWEST_ANALYSES, campaign=campaign).items
    for each in newest:
        if each.state in UNFINISHED:
            return f" yet: analysis {each.id} is {each.state}."
    return f": run `eigenfail analyze {campaign}`."


def _read_behaviours(store: Store, analysis: int, campaign: Campaign) -> _CampaignModes | None:
    from_start = None
    if not campaign.spec.fails_by_collision_alone:
        # These failures need not end in a collision: all their steps count, from the start.
        from_start = campaign.form.steps
    found = store.episodes.mode_courses(analysis, campaign.id, SAMPLED)
    steps_s = {course.dt_s for _, courses in found.values() for course in courses}
    read = {
        number: _make_behaviours(campaign.id, failures, courses, from_start)
        for number, (failures, courses) in found.items()
    }
    if len(steps_s) != 1 or None in read.values():
        return None
    modes = (ModeSource(analysis, number, each) for number, each in read.items() if each)
    result = store.analyses.get(analysis).result
    is_distinct, is_snapshot = _judge(result, campaign.id) if result else (False, False)
    return _CampaignModes(analysis, is_distinct, is_snapshot, steps_s.pop(), tuple(modes))


def _judge(result: AnalysisResult, campaign: int) -> tuple[bool, bool]:
    """Return whether modes are distinct, and whether more failures of a campaign were to come."""
    running = [each.running for each in result.sources if each.campaign == campaign]
    return result.distinct, any(running)


def _make_behaviours(
    campaign: int, failures: int, courses: Sequence[FailureCourse], from_start: int | None
) -> ModeBehaviours | None:
    origin: Origin = "collision" if from_start is None else "start"
    motion = read_motion([(campaign, course) for course in courses], origin)
    if motion is None:
        return None
    rows = [motion.accelerations[campaign, course.index] for course in courses]
    steps = max(map(len, rows)) if from_start is None else from_start
    # Failures that end in a collision are aligned at their ends, others at their starts; missing
    # steps are 0.
    accelerations = np.zeros((len(rows), steps), np.float32)
    for line, row in zip(accelerations, rows, strict=True):
        line[slice(steps - len(row), None) if origin == "collision" else slice(len(row))] = row
    contacts = [motion.contacts.get((campaign, course.index)) for course in courses]
    struck = tuple(each.struck for each in contacts if each)
    return ModeBehaviours(accelerations, struck if len(struck) == len(rows) else (), failures)


SEARCH = (
    "A search chooses its episodes: that it does not find a mode does not prove that the mode is "
    "gone. Replay the failures of the mode with the new version."
)


def list_notes(read: Sequence[ReadRelease]) -> Iterator[str]:
    """Yield sentences on the limits of the comparison of releases."""
    for place, each in enumerate(read):
        release = each.release
        if release.problem:
            yield f"The failure modes of {release.version} are not compared. {release.problem}"
        if len(release.fingerprints) > 1:
            yield _describe_codes(each)
        yield from _compare_builds(each, read[:place])
        for analysis in each.groups:
            yield (
                f"{release.version}: the groups of analysis {analysis} cannot be told from chance; "
                "read them as a summary."
            )
    if any(not each.release.is_random for each in read):
        yield SEARCH


def _compare_builds(read: ReadRelease, earlier: Sequence[ReadRelease]) -> Iterator[str]:
    """Yield sentences on an earlier release with the same code, and on settings that differ."""
    if not earlier:
        return
    version = read.release.version
    with_code = [each for each in earlier if each.code and each.code == read.code]
    with_build = [each for each in with_code if each.build and each.build == read.build]
    # A release is compared with the newest that has the same build, else the same code, else with
    # the one before.
    other = (with_build or with_code or [*earlier])[-1]
    differing = _list_other_settings(read, other)
    if with_build:
        yield f"{version} has the same code and settings as {other.release.version}."
    elif with_code and differing:
        yield f"{version} has the code of {other.release.version} and other settings: {differing}."
    elif with_code:
        yield f"{version} has the same code as {other.release.version}."
    elif differing:
        yield f"{version} has other settings than {other.release.version}: {differing}."


def _list_other_settings(read: ReadRelease, other: ReadRelease) -> str:
    """Return the settings of the planner that differ between two releases; empty if none does."""
    now, before = (_join_settings(each.settings.values()) for each in (read, other))
    differing = (
        f"{name} {now.get(name, 'unset')} instead of {before.get(name, 'unset')}"
        for name in sorted(now.keys() | before.keys())
        if now.get(name) != before.get(name)
    )
    return ", ".join(differing)


def _join_settings(campaigns: Iterable[Mapping[str, str]]) -> dict[str, str]:
    """Return the values of each setting over the campaigns of a release."""
    found: dict[str, dict[str, None]] = {}
    for settings in campaigns:
        for name, value in settings.items():
            found.setdefault(name, {})[value] = None
    return {name: " and ".join(sorted(values)) for name, values in found.items()}


def _describe_codes(read: ReadRelease) -> str:
    """Return a sentence on the packages whose code differed between a version's campaigns."""
    packages = sorted({name for code in read.release.fingerprints for name in code})
    differing = [
        f"{package} " + ", ".join(f"{digest} ({ids})" for digest, ids in by_digest.items())
        for package in packages
        if len(by_digest := _group_campaigns(read, package)) > 1
    ]
    return f"Version {read.release.version} ran with different code: {'; '.join(differing)}."


def _group_campaigns(read: ReadRelease, package: str) -> dict[str, str]:
    found: dict[str, list[int]] = {}
    for campaign, codes in read.codes.items():
        for digest in dict.fromkeys(code.get(package, "none") for code in codes):
            found.setdefault(digest, []).append(campaign)
    return {
        digest: f"campaign{'s' * (len(ids) > 1)} {', '.join(map(str, ids))}"
        for digest, ids in found.items()
    }
