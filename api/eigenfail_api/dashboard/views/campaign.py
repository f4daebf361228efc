"""One campaign: where it stands, what it found, what it was asked."""

from collections.abc import Iterator, Sequence
from typing import Any

import msgspec

from eigenfail.functions import disturbance_in_words, drives
from eigenfail.values import (
    FINAL_STATES,
    Analysis,
    AnalysisSettings,
    Campaign,
    CampaignState,
    Course,
    Event,
    Page,
    Priority,
    Summary,
)
from eigenfail.values.records import EpisodeRow
from eigenfail.values.sample import EpisodeSample
from eigenfail.values.variation import in_words
from eigenfail.values.worker import Presence
from eigenfail_api import steering
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.likelihood import Reference
from eigenfail_api.dashboard.views.charts import Chart
from eigenfail_api.dashboard.views.conflicts import Tiles, conflict_tiles
from eigenfail_api.dashboard.views.episodes import curve_chart, robustness_chart
from eigenfail_api.dashboard.views.lists import (
    AnalysisLine,
    EpisodeList,
    analysis_line,
    episode_list,
)
from eigenfail_api.dashboard.views.parentage import origin, replays_of
from eigenfail_api.dashboard.views.states import WORKING
from eigenfail_api.dashboard.views.summaries import Figure, Standing, standing
from eigenfail_services.campaigns.peers import BASELINE

SEARCHED = "of the episodes that the method chose: no rate under p(x)"
WISHES = {"pause": steering.PAUSE, "resume": steering.RESUME, "cancel": steering.CANCEL}


class Findings(msgspec.Struct, frozen=True, kw_only=True):
    """What the store knows of a campaign.

    Attributes:
        campaign: as it stands.
        summary: of its results.
        course: how its figures moved.
        rows: a sample of its completed episodes.
        listed: the first failures of the list.
        analyses: newest first.
        events: newest first.
        latest: the id of the newest event, of any campaign.
        here: the workers that are connected now.
        stranded: what was said of it, if no connected worker can run it.
        reference: what the likelihood of the failures is held against; None where it is not known.
        at_ms: when this was read.
    """

    campaign: Campaign
    summary: Summary
    course: Course
    rows: Sequence[EpisodeSample]
    listed: Page[EpisodeRow]
    analyses: tuple[Analysis, ...]
    events: tuple[Event, ...]
    latest: int
    here: Sequence[Presence]
    stranded: tuple[Event, ...]
    reference: Reference | None
    at_ms: int


class CampaignView(msgspec.Struct, frozen=True, kw_only=True):
    """The page of a campaign.

    Attributes:
        origin: words and address of what it replays; None if it is no replay.
        replays: where the replays of its episodes are listed.
        wants_workers: whether there is work and nobody to do it.
        stranded: what was said of it, if no connected worker can run it.
        wishes: what a user may ask of it now: pause, resume, cancel.
        conflicts: episodes by class; empty before the first one, and where nothing drives.
        asked: how the form analyses unless its user says otherwise.
        priorities: what its priority may be changed to.
        settings: groups of names and values.
        as_of: how far the campaign was when this was read; empty once it has ended.
    """

    standing: Standing
    origin: tuple[str, str] | None
    replays: str
    wants_workers: bool
    stranded: tuple[Event, ...]
    wishes: tuple[str, ...]
    tiles: tuple[tuple[str, Figure], ...]
    conflicts: Tiles
    charts: tuple[Chart, ...]
    failures: EpisodeList
    analyses: tuple[AnalysisLine, ...]
    asked: AnalysisSettings
    events: tuple[Event, ...]
    times: tuple[tuple[str, str], ...]
    priorities: tuple[Priority, ...]
    settings: tuple[tuple[str, tuple[tuple[str, str], ...]], ...]
    digest: str
    as_of: str
    latest: int


def campaign_view(found: Findings) -> CampaignView:
    """The page of a campaign."""
    campaign = found.campaign
    now = standing(campaign, found.summary)
    return CampaignView(
        standing=now,
        origin=origin(campaign.spec),
        replays=replays_of(campaign.id),
        wants_workers=campaign.state in WORKING and not found.here,
        stranded=found.stranded,
        wishes=wishes(campaign.state),
        tiles=tiles(now, likelihood(found), is_sampled=campaign.spec.method == BASELINE),
        conflicts=conflict_tiles(found.summary) if drives(campaign.spec) else (),
        charts=charts(found),
        failures=episode_list(campaign, found.listed, None),
        analyses=tuple(map(analysis_line, found.analyses)),
        asked=AnalysisSettings(),
        events=found.events,
        times=times(campaign),
        priorities=priorities(campaign),
        settings=settings(campaign),
        digest=campaign.digest or "",
        as_of=as_of(found) if now.is_open else "",
        latest=found.latest,
    )


def charts(found: Findings) -> tuple[Chart, ...]:
    """What can be drawn of what there is."""
    course, rows = found.course, found.rows
    drawn = (curve_chart(course), robustness_chart(rows, course, found.campaign.counts.completed))
    return drawn if rows else ()


def wishes(state: CampaignState) -> tuple[str, ...]:
    """What makes sense to ask of a campaign in this state."""
    return tuple(name for name, wish in WISHES.items() if state in wish.steps)


def priorities(campaign: Campaign) -> tuple[Priority, ...]:
    """The priorities that it may have instead of its own; none once it has ended."""
    others = tuple(each for each in Priority if each is not campaign.spec.priority)
    return () if campaign.state in FINAL_STATES else others


def tiles(now: Standing, likelihood: Figure, *, is_sampled: bool) -> tuple[tuple[str, Figure], ...]:
    """The figures at the top; what was searched for is no rate under p(x)."""
    searched = () if is_sampled else (SEARCHED,)
    failures = Figure(now.failures.value, (*now.failures.notes, *searched))
    return (
        ("Cost per failure", now.cost),
        ("Failures", failures),
        *([("Failure probability", now.probability)] if now.probability else []),
        ("log p per step [nats]", likelihood),
        ("Mean severity [m²/s²]", now.severity),
        ("Episodes/s", now.speed),
        ("Cost so far" if now.is_open else "Cost in all", now.total),
    )


def likelihood(found: Findings) -> Figure:
    """log p per step of the failures, and what it is held against."""
    counted = formats.counted(found.campaign.counts.failures, "failure")
    value = formats.number(found.summary.log_probability_per_step)
    if found.reference is None:
        return Figure(value, (f"of {counted}",))
    typical, none = (
        f"{formats.number(each)} {words}"
        for each, words in (
            (found.reference.typical, "for typical noise of p(x)"),
            (found.reference.none, "without noise"),
        )
    )
    basis = f"both over the steps of {formats.counted(found.reference.failures, 'failure')}"
    return Figure(value, (f"of {counted}", typical, none, basis))


def as_of(found: Findings) -> str:
    """How far the campaign was: its part below is worked out less often."""
    completed = formats.counted(found.campaign.counts.completed, "completed episode")
    at = formats.moment(found.at_ms)
    return f"As of {completed}, {at}; means and charts may know a few more."


def times(campaign: Campaign) -> tuple[tuple[str, str], ...]:
    """When what happened, and how urgent it is."""
    return (
        ("Priority", campaign.spec.priority),
        ("Created", formats.moment(campaign.created_ms)),
        ("Started", formats.moment(campaign.started_ms)),
        ("Ended", formats.moment(campaign.ended_ms)),
        ("Active", formats.duration(campaign.active_s)),
        ("Not runnable", formats.counted(campaign.counts.failed, "episode")),
        ("Duplicates", formats.integer(campaign.counts.duplicates)),
        *trained(campaign),
    )


def trained(campaign: Campaign) -> Iterator[tuple[str, str]]:
    """How many episodes its learner was trained with; nothing where the method does not say."""
    if campaign.trained_episodes is not None:
        yield "Trained with", formats.counted(campaign.trained_episodes, "episode")


def settings(campaign: Campaign) -> tuple[tuple[str, tuple[tuple[str, str], ...]], ...]:
    """What was asked for, in groups; a plug-in's defaults stand where nothing is given."""
    spec = campaign.spec
    general = {
        "seed": spec.seed,
        "episodes": spec.episodes,
        "simulator": spec.simulator,
        "scene kept every": spec.scene_every,
        "instances": spec.instances,
        "price [USD/h]": spec.price_usd_per_hour,
        **{f"stops at {name}": limit for name, limit in spec.stop.given().items()},
    }
    return (
        ("Campaign", pairs(general)),
        (f"Method {spec.method}", pairs(spec.settings)),
        (f"Scenario {spec.scenario}", pairs(in_words(spec.scenario_parameters))),
        (f"Planner {spec.planner}", pairs(spec.planner_settings)),
        ("Disturbance model", pairs(disturbance_in_words(spec))),
    )


def pairs(values: dict[str, Any]) -> tuple[tuple[str, str], ...]:
    """Names and values as text."""
    return tuple((name, str(value)) for name, value in values.items())
