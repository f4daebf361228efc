"""The page of a campaign: its progress, its results, and its settings."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Annotated, Any, Literal
from urllib.parse import urlencode

import msgspec
from fastapi import APIRouter, Header, Query
from fastapi.responses import HTMLResponse
from markupsafe import Markup
from starlette.background import BackgroundTask

from eigenfail import worlds
from eigenfail.errors import Conflict
from eigenfail.methods import NarrowCampaign, traits_of
from eigenfail.presentation import figures
from eigenfail.presentation.campaigns import list_labels
from eigenfail.presentation.episodes import describe_minimal_failure
from eigenfail.values import (
    FINAL_STATES,
    Analysis,
    AnalysisSettings,
    AnalysisState,
    Campaign,
    CampaignSpec,
    CampaignState,
    Course,
    Event,
    MeanTime,
    MinimalFailure,
    Page,
    Priority,
    Summary,
)
from eigenfail.values.campaign_spec import SPEC_FIELDS
from eigenfail.values.operations import Presence
from eigenfail.values.records import EpisodeRow
from eigenfail.values.summary import EpisodeSample
from eigenfail.values.variation import in_words
from eigenfail.versions import describe_mixed
from eigenfail.wire.http import PREFIX
from eigenfail_api.dashboard import episodes_page, rendering
from eigenfail_api.dashboard.charts import (
    MOST_FAILURES,
    Chart,
    PriorReference,
    find_reference,
    make_curve_chart,
    make_robustness_chart,
)
from eigenfail_api.dashboard.cost_charts import REPLAY
from eigenfail_api.dashboard.measures_page import read_measures
from eigenfail_api.parameters import CampaignId, Stored
from eigenfail_api.routes import campaigns
from eigenfail_services.campaigns import costs
from eigenfail_services.campaigns.minimal_failures import METHOD as MINIMAL
from eigenfail_services.campaigns.minimal_failures import find_minimal_failure
from eigenfail_services.campaigns.summary import (
    count_present,
    find_course,
    find_narrow,
    list_unrunnable,
    make_staffing,
    summarise,
)
from eigenfail_services.store import Store
from eigenfail_services.store.clock import now_ms

PARENTS = {"analysis": "/analyses/{}", "campaign": "/campaigns/{}"}
"""Settings of a replay, with the pages of what they name."""


def find_origin(spec: CampaignSpec) -> tuple[str, str] | None:
    """Return name and address of the episode or analysis that a replay repeats; None otherwise."""
    if spec.method != REPLAY:
        return None
    named = ((kind, spec.settings.get(kind)) for kind in PARENTS)
    return next((make_origin_link(kind, found) for kind, found in named if found is not None), None)


def make_origin_link(kind: str, number: int) -> tuple[str, str]:
    """Return name and address of the episode or analysis that a replay repeats."""
    return f"{kind} {number}", PARENTS[kind].format(number)


def make_replays_address(campaign: int) -> str:
    """Return the address of the replays of a campaign's episodes."""
    return f"/?{urlencode({'method': REPLAY, 'search': f'replay of {campaign}/'})}"


Tiles = tuple[tuple[str, rendering.Tile], ...]


def make_conflict_tiles(summary: Summary) -> Tiles:
    """Return the tiles of the conflict measures; none before the first episode has ended."""
    found, counts = summary.conflicts, summary.counts
    if not counts.completed:
        return ()
    of_all = (f"of {figures.format_count(counts.completed)}",)
    of_collisions = (f"of {figures.count_noun(found.collisions, 'collision')}",)
    unclassified = rendering.Tile(figures.format_count(found.unclassified), of_collisions)
    return (
        ("Near misses", rendering.Tile(figures.format_count(found.near_misses), of_all)),
        ("Unavoidable", rendering.Tile(figures.format_count(found.unavoidable), of_collisions)),
        (
            "Planner failures",
            rendering.Tile(figures.format_count(found.planner_failures), of_collisions),
        ),
        *((("Not classified", unclassified),) if found.unclassified else ()),
        ("Lead time of MinTTC", make_mean_tile(found.ttc_lead)),
        ("Lead time of DRAC", make_mean_tile(found.drac_lead)),
    )


def make_mean_tile(time: MeanTime) -> rendering.Tile:
    """Return the tile of a mean with its basis."""
    if time.mean_s is None:
        return rendering.Tile(figures.UNKNOWN, ("no such collision",))
    return rendering.Tile(
        f"{figures.format_number(time.mean_s)} s", (f"mean of {figures.format_count(time.n)}",)
    )


SEARCHED = "search rate, not a failure probability under p(x)"
WISHES = {"pause": campaigns.PAUSE, "resume": campaigns.RESUME, "cancel": campaigns.CANCEL}


class Findings(msgspec.Struct, frozen=True, kw_only=True):
    """What the store knows of a campaign.

    Attributes:
        campaign: as it stands.
        summary: summary of its results.
        course: how its figures moved.
        rows: a sample of its completed episodes.
        listed: the first failures of the list.
        analyses: newest first.
        events: newest first.
        latest: the id of the newest event, of any campaign.
        here: the workers that are connected now.
        stranded: what was said of it, if no connected worker can run it.
        narrow: itself, if it runs and leaves workers idle since it is too narrow; else nothing.
        minimal: least noise with which its failure still happens; None of another method, and
            before a replay has failed.
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
    narrow: tuple[NarrowCampaign, ...]
    minimal: MinimalFailure | None
    reference: PriorReference | None
    at_ms: int


class NextStep(msgspec.Struct, frozen=True):
    """What users do next with the results of a campaign.

    Attributes:
        verb: label of its button or link.
        words: what it does, in a sentence.
        command: command that does the same.
        address: page to open, or route that takes the action.
        leads_to: page of what an action makes, without its id; empty if the step is a page to open.
    """

    verb: str
    words: str
    command: str
    address: str
    leads_to: str = ""

    @property
    def is_action(self) -> bool:
        """Whether it makes something new."""
        return bool(self.leads_to)


def list_next_steps(found: Findings) -> Iterator[NextStep]:
    """Yield the steps that the failures of a campaign call for; none without a failure."""
    campaign, lines = found.campaign, found.listed.items
    if not lines or campaign.spec.method in {REPLAY, MINIMAL}:
        return
    done = [each for each in found.analyses if each.state is AnalysisState.DONE]
    if done:
        newest = done[0].id
        yield NextStep(
            "Open the modes",
            f"Analysis {newest} is the newest of these failures.",
            f"eigenfail mode list {newest}",
            f"/analyses/{newest}",
        )
        yield NextStep(
            "Replays of the modes",
            "The page of the analysis replays eigenfailures and medoids, and has the results.",
            f"eigenfail analyze {campaign.id} --prove",
            f"/analyses/{newest}#proof",
        )
    else:
        yield NextStep(
            "Analyse",
            "Group the failures into modes, each with its eigenfailure.",
            f"eigenfail analyze {campaign.id}",
            f"{PREFIX}/campaigns/{campaign.id}/analyses",
            "/analyses/",
        )
    worst = f"{campaign.id}/{lines[0].index}"
    yield NextStep(
        "Shrink",
        f"Find the least noise with which failure {worst} still happens.",
        f"eigenfail episode shrink {worst}",
        f"{PREFIX}/campaigns/{campaign.id}/episodes/{lines[0].index}/shrink",
        "/campaigns/",
    )


class CampaignView(msgspec.Struct, frozen=True, kw_only=True):
    """The page of a campaign.

    Attributes:
        next_steps: what its failures call for, once it has ended.
        minimal: sentences on the minimal failure that it has found; empty without one.
        minimal_address: page of that episode.
        origin: words and address of what it replays; None if it is no replay.
        replays: where the replays of its episodes are listed.
        wants_workers: whether episodes wait and no worker is connected.
        stranded: what was said of it, if no connected worker can run it.
        narrow: why workers are idle and what to set, if it leaves them idle; else nothing.
        wishes: what a user may ask of it now: pause, resume, cancel, archive, restore.
        questions: what the page asks before some of them.
        mixed: that services of other versions took it over, in sentences; empty if none did.
        left_out: what its scenario leaves out of its recording, in sentences.
        conflicts: episodes by class; empty before the first one, and where nothing drives.
        asked: how the form analyses unless its user says otherwise.
        priorities: what its priority may be changed to.
        settings: groups of names and values.
        as_of: how far the campaign was when this was read; empty once it has ended.
    """

    standing: rendering.StandingView
    next_steps: tuple[NextStep, ...]
    minimal: tuple[str, ...]
    minimal_address: str
    origin: tuple[str, str] | None
    replays: str
    wants_workers: bool
    stranded: tuple[Event, ...]
    narrow: tuple[NarrowCampaign, ...]
    mixed: tuple[str, ...]
    left_out: tuple[str, ...]
    wishes: tuple[str, ...]
    questions: Mapping[str, str]
    tiles: tuple[tuple[str, rendering.Tile], ...]
    conflicts: Tiles
    charts: tuple[Chart, ...]
    failures: episodes_page.EpisodeList
    analyses: tuple[episodes_page.AnalysisLine, ...]
    asked: AnalysisSettings
    choices: episodes_page.AnalysisChoices
    events: tuple[Event, ...]
    times: tuple[tuple[str, str], ...]
    priorities: tuple[Priority, ...]
    settings: tuple[tuple[str, tuple[tuple[str, str], ...]], ...]
    digest: str
    as_of: str
    latest: int


def make_campaign_view(found: Findings) -> CampaignView:
    """Return the page of a campaign."""
    campaign = found.campaign
    now = rendering.make_standing(campaign, found.summary)
    channels = worlds.list_channels(campaign.spec)
    return CampaignView(
        standing=now,
        next_steps=() if now.is_open else tuple(list_next_steps(found)),
        minimal=describe_minimal_failure(found.minimal) if found.minimal else (),
        minimal_address=episodes_page.make_episode_address(
            found.minimal.campaign, found.minimal.index
        )
        if found.minimal
        else "",
        origin=find_origin(campaign.spec),
        replays=make_replays_address(campaign.id),
        wants_workers=campaign.state in rendering.WORKING and not found.here,
        stranded=found.stranded,
        narrow=found.narrow,
        mixed=describe_mixed(campaign),
        left_out=worlds.world_of(campaign.spec.simulator).list_left_out(campaign.spec),
        wishes=list_actions(campaign),
        questions=QUESTIONS,
        tiles=make_tiles(
            now,
            make_likelihood_tile(found),
            is_sampled=traits_of(campaign.spec.method).draws_from_prior,
        ),
        conflicts=make_conflict_tiles(found.summary)
        if worlds.world_of(campaign.spec.simulator).has_road
        else (),
        charts=make_charts(found),
        failures=episodes_page.make_episode_list(
            campaign, found.listed, episodes_page.find_failure_order(campaign)
        ),
        analyses=tuple(episodes_page.make_analysis_line(each, channels) for each in found.analyses),
        asked=AnalysisSettings(),
        choices=episodes_page.list_analysis_choices(campaign.spec),
        events=found.events,
        times=list_times(campaign),
        priorities=list_priorities(campaign),
        settings=group_settings(campaign),
        digest=campaign.digest or "",
        as_of=as_of(found) if now.is_open else "",
        latest=found.latest,
    )


def make_charts(found: Findings) -> tuple[Chart, ...]:
    """Return the charts for which there are data."""
    course, rows = found.course, found.rows
    unit = worlds.find_robustness_unit(found.campaign.spec)
    drawn = (
        make_curve_chart(course, unit),
        make_robustness_chart(rows, course, found.campaign.counts.completed, unit),
    )
    return drawn if rows else ()


QUESTIONS = {
    "cancel": "Cancel this campaign? Its finished episodes are kept, but it cannot be resumed.",
    "archive": "Archive this campaign? Nothing is deleted: lists omit the campaign until it is "
    "restored. Restore on this page brings it back.",
}
"""What the page of a campaign asks before an action."""


def list_actions(campaign: Campaign) -> tuple[str, ...]:
    """Return the actions that are possible in the present state of a campaign."""
    steered = tuple(name for name, wish in WISHES.items() if campaign.state in wish.steps)
    if campaign.state not in FINAL_STATES:
        return steered
    return (*steered, "archive" if campaign.archived_ms is None else "restore")


def list_priorities(campaign: Campaign) -> tuple[Priority, ...]:
    """Return the priorities that a campaign can change to; none once it has ended."""
    others = tuple(each for each in Priority if each is not campaign.spec.priority)
    return () if campaign.state in FINAL_STATES else others


def make_tiles(
    now: rendering.StandingView, likelihood: rendering.Tile, *, is_sampled: bool
) -> tuple[tuple[str, rendering.Tile], ...]:
    """Return the tiles at the top; a search's rate has the note that it is none under p(x)."""
    searched = () if is_sampled else (SEARCHED,)
    failures = msgspec.structs.replace(now.failures, notes=(*now.failures.notes, *searched))
    return (
        ("Cost per failure", now.cost),
        ("Failures", failures),
        *([("Failure probability", now.probability)] if now.probability else []),
        ("log p per step [nats]", likelihood),
        ("Mean severity [m²/s²]", now.severity),
        ("Episodes/s", now.speed),
        ("Cost so far" if now.is_open else "Total cost", now.total),
    )


def make_likelihood_tile(found: Findings) -> rendering.Tile:
    """Return the tile of log p per step of the failures, and of noise drawn from p(x)."""
    counted = figures.count_noun(found.campaign.counts.failures, "failure")
    value = figures.format_number(found.summary.log_probability_per_step)
    if found.reference is None:
        return rendering.Tile(value, (f"of {counted}",))
    typical, none = (
        f"{figures.format_number(each)} {words}"
        for each, words in (
            (found.reference.typical, "for typical noise of p(x)"),
            (found.reference.none, "without noise"),
        )
    )
    basis = f"both over the steps of {figures.count_noun(found.reference.failures, 'failure')}"
    return rendering.Tile(value, (f"of {counted}", typical, none, basis))


def as_of(found: Findings) -> str:
    """How far the campaign was: its part below is worked out less often."""
    completed = figures.count_noun(found.campaign.counts.completed, "completed episode")
    at = rendering.write_time(found.at_ms)
    words = Markup("As of {}, {}; means and charts may include later episodes.")
    return words.format(completed, at)


def list_times(campaign: Campaign) -> tuple[tuple[str, str], ...]:
    """Return the times of the campaign's changes of state, and its priority."""
    return (
        ("Priority", campaign.spec.priority),
        ("Created", rendering.write_time(campaign.created_ms)),
        ("Started", rendering.write_time(campaign.started_ms)),
        ("Ended", rendering.write_time(campaign.ended_ms)),
        ("Active", figures.format_duration(campaign.active_s)),
        ("Errored", figures.count_noun(campaign.counts.errored, "episode")),
        ("Duplicates", figures.format_count(campaign.counts.duplicates)),
        *describe_training(campaign),
    )


def describe_training(campaign: Campaign) -> Iterator[tuple[str, str]]:
    """How many episodes its learner was trained with; nothing where the method does not say."""
    if campaign.trained_episodes is not None:
        yield "Trained with", figures.count_noun(campaign.trained_episodes, "episode")


def group_settings(campaign: Campaign) -> tuple[tuple[str, tuple[tuple[str, str], ...]], ...]:
    """Return the fields of the spec in groups, with a plug-in's defaults where nothing is given."""
    spec = campaign.spec
    general = {
        **{field.label: getattr(spec, name) for name, field in SPEC_FIELDS.items() if field.label},
        **{f"stops at {name}": limit for name, limit in spec.stop.given().items()},
        **dict(list_labels(spec)),
    }
    return (
        ("Campaign", list_pairs(general)),
        (f"Method {spec.method}", list_pairs(spec.settings)),
        (f"Scenario {spec.scenario}", list_pairs(in_words(spec.scenario_parameters))),
        (f"Planner {spec.planner}", list_pairs(spec.planner_settings)),
        ("Disturbance model", list_pairs(worlds.describe_disturbance(spec))),
        *(
            [("Requirements", list_pairs(named))]
            if (named := worlds.describe_requirements(spec))
            else []
        ),
    )


def list_pairs(values: dict[str, Any]) -> tuple[tuple[str, str], ...]:
    """Return names and values as text."""
    return tuple(
        (name, "not set" if value is None else str(value)) for name, value in values.items()
    )


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

CAMPAIGNS_ON_A_PAGE = 50
ANALYSES_ON_A_PAGE = 20
EVENTS_SHOWN = 30

# A form sends empty fields, too.
State = Annotated[CampaignState | Literal[""], Query()]
Words = Annotated[str, Query(max_length=200)]

# An open page sends it when it asks for itself again.
Again = Annotated[str | None, Header(alias="HX-Request", include_in_schema=False)]


@router.get("/campaigns/{campaign}")
def show_campaign(store: Stored, campaign: CampaignId, again: Again = None) -> HTMLResponse:
    """Serve the page of a campaign; its slow second part is included only if it is cached."""
    latest, seen = store.events.last(), store.campaigns.get(campaign)
    with store.figures.as_of(seen):
        return _serve_campaign(store, seen, latest, again)


def _serve_campaign(store: Store, seen: Campaign, latest: int, again: str | None) -> HTMLResponse:
    begun = () if again else costs.prefetch_figures(store, seen)
    listed = episodes_page.read_failures(store, seen, episodes_page.find_failure_order(seen))
    first = [row.index for row in listed.items[:MOST_FAILURES]]
    here, lacking = count_present(store), list_unrunnable(store)
    found = Findings(
        campaign=seen,
        summary=read_summary(store, seen),
        course=find_course(store, seen),
        rows=store.figures.samples(seen.id),
        listed=listed,
        analyses=store.analyses.page(ANALYSES_ON_A_PAGE, None, seen.id).items,
        events=tuple(store.events.latest(EVENTS_SHOWN, seen.id)),
        latest=latest,
        here=here,
        stranded=tuple(each for each in lacking if each.campaign == seen.id),
        narrow=find_narrow(store, seen, len(here)),
        minimal=read_minimal_failure(store, seen),
        reference=find_reference(store, seen.id, first),
        at_ms=now_ms(),
    )
    measures = (
        read_measures(seen, costs.read_figures(store, seen))
        if begun and costs.is_prefetched(begun)
        else None
    )
    staffing = partial(make_staffing, store, len(here), lacking)
    response = rendering.page(
        "campaign.html", make_campaign_view(found), measures=measures, staffing=staffing
    )
    response.background = BackgroundTask(costs.wait_for_figures, begun)
    return response


def read_minimal_failure(store: Store, campaign: Campaign) -> MinimalFailure | None:
    """Return the minimal failure that a campaign has found so far; None without one."""
    if campaign.spec.method != MINIMAL:
        return None
    try:
        return find_minimal_failure(store, campaign)
    except Conflict:
        return None


def read_summary(store: Store, campaign: Campaign) -> Summary:
    """Return the summary of a campaign."""
    return summarise(campaign, store.episodes.totals(campaign.id))
