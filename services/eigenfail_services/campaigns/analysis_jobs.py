"""Analyses of campaigns: their failures, and the processes that compute them.

Each analysis runs in a separate process: if it is slow or dies, nothing else suffers.
"""

import os
import subprocess
import sys
import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, Literal, NamedTuple, Self

import msgspec
from msgspec.structs import replace

from eigenfail.contracts import ModeProbability
from eigenfail.errors import InputError, InvalidValue, describe_error, read_text
from eigenfail.methods import traits_of
from eigenfail.presentation.analyses import describe_grouping
from eigenfail.processes import NUMERIC_ENVIRONMENT, as_parent, exit_status, kill_group
from eigenfail.values.analysis import (
    AnalysedCampaign,
    Analysis,
    AnalysisResult,
    AnalysisSettings,
    FailureMode,
)
from eigenfail.values.campaign import FINAL_STATES, Campaign, EpisodeForm
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.records import Job
from eigenfail.worlds import drawn_for, world_of
from eigenfail_services.analysis.alignment import check_clusterer, choose_columns
from eigenfail_services.bounds import NO_BOUNDS, SettingBounds
from eigenfail_services.campaigns.explanations import describe_modes
from eigenfail_services.campaigns.mode_probability import add_probabilities
from eigenfail_services.campaigns.references import refuse_missing
from eigenfail_services.hub.metrics import Timeout
from eigenfail_services.methods import find_first_sample
from eigenfail_services.resolution import resolve_method
from eigenfail_services.store.store import Store

WORLD_FIELDS = (
    "scenario",
    "scenario_parameters",
    "planner",
    "planner_settings",
    "simulator",
    "requirements",
)
"""Fields that may differ between campaigns that are analysed together, and are then reported."""


class AnalysisBasis(NamedTuple):
    """Campaigns that an analysis takes its failures from.

    Attributes:
        campaigns: each campaign once, the analysed campaign first. Their states are read before
            their failures, so that the failures of an ended campaign are complete.
        form: length and channels of their episodes.
        step_s: duration of a step; None if steps are without a duration, or if failures need not
            end in a collision to measure times from. [s]
        has_road: whether an ego drives in them.
    """

    campaigns: tuple[Campaign, ...]
    form: EpisodeForm
    step_s: float | None
    has_road: bool

    @property
    def origin(self) -> Literal["collision", "start"]:
        """Return the moment at which the behaviour in failures is aligned."""
        return "start" if self.step_s is None else "collision"

    @property
    def ended(self) -> dict[int, int]:
        """Return the number of episodes that have ended, by id of their campaign."""
        return {each.id: each.counts.completed + each.counts.errored for each in self.campaigns}

    def find_drawn(self, mode: FailureMode, store: Store) -> dict[str, Any]:
        """Return the scenario parameters that the medoid of a mode drew, by name."""
        specs = {each.id: each.spec for each in self.campaigns}
        campaign = mode.medoid_campaign or self.campaigns[0].id
        return drawn_for(specs[campaign], store.episodes.get(campaign, mode.medoid).seed)

    def update_counts(self, store: Store) -> Self:
        """Return the basis with the present counts, which cover all failures that were read."""
        now = ((each, store.campaigns.get(each.id).counts) for each in self.campaigns)
        return self._replace(campaigns=tuple(replace(each, counts=c) for each, c in now))

    def sources(self, rows: Sequence[int]) -> tuple[AnalysedCampaign, ...]:
        """Return the analysed campaigns, each with the number of its failures among the rows."""
        return tuple(
            AnalysedCampaign(
                campaign=each.id,
                episodes=self.ended[each.id],
                failures=rows.count(each.id),
                running=each.state not in FINAL_STATES,
            )
            for each in self.campaigns
        )


def find_basis(store: Store, campaign: int, settings: AnalysisSettings) -> AnalysisBasis:
    """Return the basis of an analysis of a campaign and the further campaigns in its settings.

    Raises:
        NotFound: the campaign does not exist.
        UnknownName: the settings name a channel that its noise does not have.
        InvalidValue: a further campaign does not exist or cannot be analysed together with the
            first; or the clusterer would ignore a setting; or the alignment is meaningless here.
    """
    check_clusterer(settings)
    first = store.campaigns.get(campaign)
    with refuse_missing("campaigns"):
        others = [store.campaigns.get(each) for each in dict.fromkeys(settings.campaigns)]
    campaigns = (first, *(other for other in others if other.id != campaign))
    world = world_of(first.spec.simulator)
    if settings.align == "collision" and not world.has_road:
        problem = "all calls of a function end at their last step: no time of a collision differs."
        raise InvalidValue("align", problem, "Align at the start.")
    may_violate = not all(each.spec.fails_by_collision_alone for each in campaigns)
    if settings.align == "collision" and may_violate:
        problem = "failures of campaigns with requirements need not end in a collision."
        raise InvalidValue("align", problem, "Align at the start.")
    choose_columns(settings.axes, first.form.channels)
    for other in campaigns[1:]:
        _refuse_unlike(first, other)
    step_s = None if may_violate else first.form.step_s
    return AnalysisBasis(campaigns, first.form, step_s, world.has_road)


def _refuse_unlike(first: Campaign, other: Campaign) -> None:
    """Raise InvalidValue if the noise of two campaigns cannot be analysed together."""
    compared = {
        "episodes of another number of steps": (first.form.steps, other.form.steps),
        "steps of another duration": (first.form.step_s, other.form.step_s),
        "noise with other channels": (first.form.channels, other.form.channels),
        "another disturbance model: one z is not the same noise in both": (
            first.spec.disturbance,
            other.spec.disturbance,
        ),
    }
    for words, (one, another) in compared.items():
        if one != another:
            raise InvalidValue(
                "campaigns", f"campaign {other.id} has {words}.", "Analyse it by itself."
            )


def list_notes(found: AnalysisBasis) -> tuple[str, ...]:
    """Return caveats of an analysis of several campaigns, or of campaigns that still run."""
    first, *others = [campaign.spec for campaign in found.campaigns]
    differing = [
        name
        for name in WORLD_FIELDS
        if any(read_world_field(first, name) != read_world_field(each, name) for each in others)
    ]
    running = sorted(each.id for each in found.campaigns if each.state not in FINAL_STATES)
    still = ", ".join(map(str, running))
    words = {
        f"The campaigns differ in {', '.join(differing)}: a mode may be of one of them.": differing,
        f"A snapshot: more episodes were to come in campaign {still}.": running,
    }
    return tuple(sentence for sentence, reason in words.items() if reason)


def read_world_field(spec: CampaignSpec, name: str) -> Any:
    """Return one of `WORLD_FIELDS`; the requirements also if they are the default."""
    return spec.all_requirements if name == "requirements" else getattr(spec, name)


LEASE_S = 30.0
DATABASE_VARIABLE = "EIGENFAIL_DATABASE"

LOOK = (
    "services.log in the data folder shows the cause (in a container: its standard"
    " error). Launch it again."
)

ROOM = (
    "Give the services' machine or container room for more processes and memory, and launch it"
    " again."
)

LONGER = (
    "Analyse fewer campaigns at a time or with a smaller bootstrap, or start the services with a"
    " larger --analysis-limit."
)


class RunningAnalysis(msgspec.Struct):
    """The process of an analysis, its job, and the time at which the job's lease is renewed."""

    job: Job
    process: "subprocess.Popen[bytes]"
    timeout: Timeout
    renew_s: float = 0.0


class AnalysisJobs:
    """Starts a process for each claimed analysis, and records its end.

    Args:
        database: URL of the store; passed in the environment, so that process lists do not show its
            password.
        bounds: limits of each process.
    """

    def __init__(self, store: Store, database: str, bounds: SettingBounds = NO_BOUNDS) -> None:
        self._store = store
        self._bounds = bounds
        self._environment = (
            os.environ | NUMERIC_ENVIRONMENT | as_parent() | {DATABASE_VARIABLE: database}
        )
        self._running: list[RunningAnalysis] = []

    def __len__(self) -> int:
        """Return the number of running analyses."""
        return len(self._running)

    def open(self, job: Job) -> None:
        """Start the process of an analysis, unless it runs here already with a lost lease."""
        for running in self._running:
            if running.job.subject == job.subject:
                running.job = job
                return
        try:
            self._running.append(self._started(job))
        except OSError as error:
            problem = f"The analysis process could not be started: {error.strerror}. {ROOM}"
            self._store.analyses.fail(job.subject, problem)
            self._store.jobs.finish(job)

    def _started(self, job: Job) -> RunningAnalysis:
        command = [sys.executable, "-m", "eigenfail_services", "analyse", str(job.subject)]
        # The analysis leads a process group, so that whatever it starts can be killed with it.
        process = subprocess.Popen(command, env=self._environment, process_group=0)
        self._bounds.confine(process.pid)
        return RunningAnalysis(job, process, Timeout(self._bounds.time_s))

    def poll(self) -> None:
        """Renew the leases of running analyses, and conclude the ended ones."""
        self._running = [running for running in self._running if not self._ended(running)]

    def _ended(self, running: RunningAnalysis) -> bool:
        status = exit_status(running.process)
        if status is None and not running.timeout.has_expired():
            self._renew(running)
            return False
        if status is not None and status < 0:
            # Killed from outside: the next claim of the job starts it anew.
            kill_group(running.process)
            self._store.jobs.renew(running.job, 0.0)
            return True
        # The reason is stored before the job is removed: after a crash in between, the next claim
        # finds an analysis that has ended.
        if problem := self._problem(status):
            self._store.analyses.fail(running.job.subject, problem)
        kill_group(running.process)
        self._store.jobs.finish(running.job)
        return True

    def _problem(self, status: int | None) -> str:
        """Return why an analysis failed or is ended; empty if it succeeded."""
        if status is None:  # it would take as long the next time
            took = f"The analysis took more than {self._bounds.time_s:g} s, and was broken off."
            return f"{took} {LONGER}"
        return f"The analysis process ended with status {status}. {LOOK}" if status else ""

    def _renew(self, running: RunningAnalysis) -> None:
        if time.monotonic() >= running.renew_s:
            # A lease is as long as three renewals, so that one that is late or fails costs no
            # lease.
            running.renew_s = time.monotonic() + LEASE_S / 3
            self._store.jobs.renew(running.job, LEASE_S)

    def stop(self) -> None:
        """End all running analyses; the next supervisor starts them again."""
        for running in self._running:
            kill_group(running.process)
            self._store.jobs.renew(running.job, 0.0)


def run_analysis(store: Store, analysis_id: int) -> None:
    """Run an analysis, and store its result or the reason why it failed."""
    analysis = store.analyses.get(analysis_id)
    store.analyses.start(analysis_id)
    try:
        store.analyses.finish(analysis_id, find_modes(store, analysis))
    except InputError as error:
        store.analyses.fail(analysis_id, read_text(error))
    except Exception as error:
        problem = f"The analysis failed with {describe_error(error)}."
        store.analyses.fail(analysis_id, f"{problem} {LOOK}")
        # Raised again, so that the log of the services has the traceback.
        raise


def _gives_proposals_up(campaign: Campaign) -> bool:
    """Return whether early failures of a campaign come from proposals that its method has given up.

    If the method estimates the probability of each mode, every failure needs its mode.
    """
    traits = traits_of(campaign.spec.method)
    return traits.learns and traits.mode_probability is ModeProbability.UNKNOWN


def leaves_early_out(settings: AnalysisSettings, campaigns: Sequence[Campaign]) -> bool:
    """Return whether an analysis leaves early failures of one of the campaigns out."""
    early = any(map(_gives_proposals_up, campaigns)) or bool(find_first_samples(campaigns))
    return settings.failures == "latest" and early


def find_first_samples(campaigns: Sequence[Campaign]) -> dict[int, int]:
    """Return the index of the first episode whose failure is a sample, by id of a campaign.

    Only campaigns of methods with a burn-in are included.
    """
    found = {each.id: _find_first_sample(each.spec) for each in campaigns}
    return {campaign: first for campaign, first in found.items() if first}


def _find_first_sample(spec: CampaignSpec) -> int:
    try:
        settings = resolve_method(spec.method, spec.settings).settings
    except InputError:  # a method that is not installed here any more
        return 0
    return find_first_sample(settings, spec.episodes)


def _describe_samples(first_samples: Mapping[int, int], result: AnalysisResult) -> Iterator[str]:
    """Yield a remark on each campaign with a burn-in: which failures were taken."""
    taken = list(zip(result.campaigns, result.episodes, strict=True))
    for campaign, first in first_samples.items():
        own = [index for number, index in taken if number == campaign]
        if own and min(own) >= first:
            yield (
                f"Campaign {campaign}: the {len(own)} failures after burn-in, from episode {first} "
                "on, were analysed, each once. Whether they are samples of p(z | failure), its "
                "mixing says."
            )
        elif own:
            yield f"Campaign {campaign}: failures from before the end of burn-in were analysed."


def _describe_grouping(
    base: AnalysisBasis, settings: AnalysisSettings, result: AnalysisResult
) -> Iterator[str]:
    """Yield a remark if failures on a road were not grouped by behaviour despite the request."""
    if settings.features != result.features and base.has_road:
        yield (
            f"The failures were grouped by {describe_grouping(result)}: the speed of the ego is "
            "not known for all of them."
        )


def _describe_given_number(settings: AnalysisSettings, result: AnalysisResult) -> Iterator[str]:
    """Yield a remark if the number of distinct modes was given, instead of found."""
    if settings.clusters is not None and result.distinct:
        yield (
            f"The number of modes, {settings.clusters}, was given (clusters): distinct are the "
            "groups, their number was not found in the failures. Leave it out to have it chosen."
        )


GROUPS = (
    "Its modes are groups of this search: another seed may find others, and their shares are no "
    "probabilities under p(x)."
)


def _describe_learning(
    gathered: Sequence[int], learning: Collection[int], result: AnalysisResult
) -> Iterator[str]:
    """Yield a remark on each campaign that learnt: which failures were taken, what modes are.

    Args:
        gathered: id of the campaign of each failure.
        learning: ids of the campaigns that learnt.
        result: result of the analysis.
    """
    for campaign in sorted(learning):
        taken, there = result.campaigns.count(campaign), gathered.count(campaign)
        if taken < there:
            yield (
                f"Campaign {campaign} learnt while it ran: the latest {taken} of its {there} "
                f"failures were analysed. Set failures to all to analyse every one. {GROUPS}"
            )
        elif taken:
            yield f"Campaign {campaign} learnt while it ran. {GROUPS}"


def _describe_whole_courses(
    campaigns: Sequence[Campaign], learning: Collection[int], result: AnalysisResult
) -> Iterator[str]:
    """Yield a remark on each campaign that learnt and whose failures are analysed in any case."""
    for campaign in campaigns:
        learnt = traits_of(campaign.spec.method).learns and campaign.id not in learning
        if learnt and campaign.id in result.campaigns:
            yield (
                f"Campaign {campaign.id} learnt while it ran, and failures of its whole course "
                "were analysed: modes may be stages of its search."
            )


def find_modes(store: Store, analysis: Analysis) -> AnalysisResult:
    """Return the failure modes among the failures that are stored by now.

    Raises:
        UnknownName: the settings name a channel that the noise does not have.
        InvalidValue: the campaigns are without failures, a failure does not fit, or the campaigns
            cannot be analysed together.
    """
    # scikit-learn takes a second to load.
    from eigenfail_services.analysis.alignment import EarlyFailures, FailureBatch, gather_failures
    from eigenfail_services.analysis.behaviour import read_motion
    from eigenfail_services.analysis.job import analyse_gathered, hash_result

    begun = find_basis(store, analysis.campaign, analysis.settings)
    # Read in portions: the noise of all failures of a long campaign may not fit into memory.
    read = (
        FailureBatch(campaign.id, failures)
        for campaign in begun.campaigns
        for failures in store.episodes.failure_portions(campaign.id)
    )
    failures = gather_failures(read, begun.form.steps, analysis.settings, begun.form.channels)
    failures = failures._replace(step_s=begun.form.step_s)
    if analysis.settings.features == "behaviour" and begun.has_road:
        courses = (
            (campaign.id, course)
            for campaign in begun.campaigns
            for course in store.episodes.failure_courses(campaign.id)
        )
        motion = read_motion(courses, begun.origin)
        failures = failures._replace(motion=motion)
    base = begun.update_counts(store)
    learning = frozenset(each.id for each in base.campaigns if _gives_proposals_up(each))
    samples = find_first_samples(base.campaigns)
    result = analyse_gathered(
        failures, analysis.settings, base.step_s, base.ended, EarlyFailures(learning, samples)
    )
    modes = tuple(replace(each, drawn=base.find_drawn(each, store)) for each in result.modes)
    result = replace(result, modes=modes)
    whole = msgspec.structs.replace(
        add_probabilities(store, base.campaigns, result),
        sources=base.sources(result.campaigns),
        notes=(
            *list_notes(base),
            *_describe_grouping(base, analysis.settings, result),
            *_describe_given_number(analysis.settings, result),
            *_describe_learning(failures.campaigns.tolist(), learning, result),
            *_describe_whole_courses(base.campaigns, learning, result),
            *_describe_samples(samples, result),
        ),
        words=describe_modes(store, analysis, result, base.step_s),
    )
    return msgspec.structs.replace(whole, digest=hash_result(whole))
