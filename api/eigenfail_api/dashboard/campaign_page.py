"""The page of a campaign: its progress, its results, and its settings."""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Annotated, Any
from urllib.parse import urlencode

import msgspec
from fastapi import APIRouter, Header
from fastapi.responses import HTMLResponse
from starlette.background import BackgroundTask

from eigenfail import worlds
from eigenfail.errors import Conflict
from eigenfail.methods import traits_of
from eigenfail.presentation import figures
from eigenfail.presentation.campaigns import list_labels
from eigenfail.presentation.episodes import describe_minimal_failure
from eigenfail.presentation.tables import format_cell
from eigenfail.values.analysis import Analysis, AnalysisSettings, AnalysisState, MinimalFailure
from eigenfail.values.campaign import FINAL_STATES, Campaign
from eigenfail.values.campaign_spec import SPEC_FIELDS, CampaignSpec, Priority
from eigenfail.values.records import EpisodeRow
from eigenfail.values.summary import MeanTime, Summary
from eigenfail.values.variation import in_words
from eigenfail.versions import describe_mixed
from eigenfail.wire.http import PREFIX
from eigenfail_api.dashboard import analysis_page, episodes_page, rendering
from eigenfail_api.dashboard.charts import (
    MOST_FAILURES,
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
    summarise_campaign,
)
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.store import Store

PARENTS = {"analysis": "/analyses/{}", "campaign": "/campaigns/{}"}
"""Settings of a replay, with the pages of what they name."""


def find_origin(spec: CampaignSpec) -> tuple[str, str] | None:
    """Return name and address of the episode or analysis that a replay repeats; None otherwise."""
    if spec.method != REPLAY:
        return None
    named = ((kind, spec.settings.get(kind)) for kind in PARENTS)
    links = ((f"{kind} {found}", PARENTS[kind].format(found)) for kind, found in named if found)
    return next(links, None)


def make_conflict_tiles(summary: Summary) -> rendering.Tiles:
    """Return the tiles of the conflict measures; none before the first episode has ended."""
    found, counts = summary.conflicts, summary.counts
    # Of no episode every tile would be a dash.
    if not counts.completed:
        return ()
    of_all = (f"of {figures.format_count(counts.completed)}",)
    of_collisions = (f"of {figures.count_noun(found.collisions, 'collision')}",)
    unclassified = rendering.Tile(found.unclassified, of_collisions)
    return (
        ("Near misses", rendering.Tile(found.near_misses, of_all)),
        ("Unavoidable", rendering.Tile(found.unavoidable, of_collisions)),
        ("Planner failures", rendering.Tile(found.planner_failures, of_collisions)),
        *((("Not classified", unclassified),) if found.unclassified else ()),
        ("Lead time of MinTTC", make_mean_tile(found.ttc_lead)),
        ("Lead time of DRAC", make_mean_tile(found.drac_lead)),
    )


def make_mean_tile(time: MeanTime) -> rendering.Tile:
    """Return the tile of a mean with its basis."""
    if time.mean_s is None:
        return rendering.Tile(None, ("no such collision",))
    return rendering.Tile(time.mean_s, (f"mean of {figures.format_count(time.n)}",), unit="s")


SEARCHED = "search rate, not a failure probability under p(x)"
WISHES = {"pause": campaigns.PAUSE, "resume": campaigns.RESUME, "cancel": campaigns.CANCEL}


class NextStep(msgspec.Struct, frozen=True):
    """A step that users take next with the results of a campaign.

    Attributes:
        verb: label of its button or link.
        words: effect of the step, in a sentence.
        command: command that does the same.
        address: page to open, or route that takes the action.
        leads_to: page of what an action makes, without its id; empty if the step is a page to open.
    """

    verb: str
    words: str
    command: str
    address: str
    leads_to: str = ""


def list_next_steps(
    campaign: Campaign, failures: Sequence[EpisodeRow], analyses: Sequence[Analysis]
) -> Iterator[NextStep]:
    """Yield the steps that the failures of a campaign call for; none without a failure."""
    # What a replay or a shrunk failure shows is known from the campaign that it repeats.
    if not failures or campaign.spec.method in {REPLAY, MINIMAL}:
        return
    # A second analysis of the same failures would find the same: its modes come next.
    done = [each for each in analyses if each.state is AnalysisState.DONE]
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
    worst = f"{campaign.id}/{failures[0].index}"
    yield NextStep(
        "Shrink",
        f"Find the least noise with which failure {worst} still happens.",
        f"eigenfail episode shrink {worst}",
        f"{PREFIX}/campaigns/{campaign.id}/episodes/{failures[0].index}/shrink",
        "/campaigns/",
    )


QUESTIONS = {
    "cancel": "Cancel this campaign? Its finished episodes are kept, but it cannot be resumed.",
    "archive": "Archive this campaign? Nothing is deleted: lists omit the campaign until it is "
    "restored. Restore on this page brings it back.",
}
"""Questions that the page of a campaign asks before an action."""


def list_actions(campaign: Campaign) -> tuple[str, ...]:
    """Return the actions that are possible in the present state of a campaign."""
    steered = tuple(name for name, wish in WISHES.items() if campaign.state in wish.steps)
    if campaign.state not in FINAL_STATES:
        return steered
    # Archiving hides a campaign from lists, and those that run must be seen.
    return (*steered, "archive" if campaign.archived_ms is None else "restore")


def make_tiles(
    campaign: Campaign, summary: Summary, reference: PriorReference | None = None
) -> rendering.Tiles:
    """Return the tiles at the top.

    Args:
        campaign: the campaign.
        summary: summary of its results.
        reference: likelihood of other noise over the steps of its failures; None if not known.
    """
    failures = rendering.make_failure_tile(summary)
    if not traits_of(campaign.spec.method).draws_from_prior:
        # A search chose these episodes. The note says that their failures are not a random sample.
        failures = msgspec.structs.replace(failures, notes=(*failures.notes, SEARCHED))
    estimate = summary.estimate
    lasted = f"in {figures.format_duration(campaign.active_s)}"
    hours = figures.format_number(summary.cost.instance_hours)
    price = f"{hours} h × {figures.format_number(campaign.spec.price_usd_per_hour)} USD/h"
    spent = "Total cost" if campaign.state in FINAL_STATES else "Cost so far"
    severity = rendering.Tile(summary.mean_severity, ("of the collisions",))
    has_road = worlds.world_of(campaign.spec.simulator).has_road
    return (
        ("Cost per failure", rendering.make_cost_tile(summary)),
        ("Failures", failures),
        *((("Failure probability", format_cell(estimate)),) if estimate else ()),
        ("log p per step [nats]", make_likelihood_tile(campaign, summary, reference)),
        *((("Mean severity [m²/s²]", severity),) if has_road else ()),
        ("Episodes/s", rendering.Tile(summary.episodes_per_s, (lasted,))),
        (spent, rendering.Tile(summary.cost.total_usd, (price,), unit="USD")),
    )


def make_likelihood_tile(
    campaign: Campaign, summary: Summary, reference: PriorReference | None
) -> rendering.Tile:
    """Return the tile of log p per step of the failures, and of noise drawn from p(x)."""
    counted = f"of {figures.count_noun(campaign.counts.failures, 'failure')}"
    value = summary.log_probability_per_step
    if reference is None:
        return rendering.Tile(value, (counted,))
    typical = f"{figures.format_number(reference.typical)} for typical noise of p(x)"
    none = f"{figures.format_number(reference.none)} without noise"
    basis = f"both over the steps of {figures.count_noun(reference.failures, 'failure')}"
    return rendering.Tile(value, (counted, typical, none, basis))


def list_times(campaign: Campaign) -> tuple[tuple[str, str], ...]:
    """Return the times of the campaign's changes of state, its priority and its training."""
    trained = campaign.trained_episodes
    times = (
        ("Priority", campaign.spec.priority),
        ("Created", rendering.write_time(campaign.created_ms)),
        ("Started", rendering.write_time(campaign.started_ms)),
        ("Ended", rendering.write_time(campaign.ended_ms)),
        ("Active", figures.format_duration(campaign.active_s)),
        ("Errored", figures.count_noun(campaign.counts.errored, "episode")),
        ("Duplicates", figures.format_count(campaign.counts.duplicates)),
    )
    # Most methods learn nothing, and do not say that they did.
    learnt = () if trained is None else (("Trained with", figures.count_noun(trained, "episode")),)
    return (*times, *learnt)


def group_settings(campaign: Campaign) -> tuple[tuple[str, tuple[tuple[str, str], ...]], ...]:
    """Return the fields of the spec in groups, with a plug-in's defaults if nothing is given."""
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
            # Without a named requirement a collision is the only failure, which the page says
            # anyway.
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

ANALYSES_ON_A_PAGE = 20
EVENTS_SHOWN = 30

# An open page sends it when it asks for itself again.
Again = Annotated[str | None, Header(alias="HX-Request", include_in_schema=False)]


@router.get("/campaigns/{campaign}")
def show_campaign(store: Stored, campaign: CampaignId, again: Again = None) -> HTMLResponse:
    """Serve the page of a campaign; its slow second part is included only if it is cached."""
    latest, seen = store.events.last(), store.campaigns.get(campaign)
    # Parts of the page are cached: they must be of the same state as the rest.
    with store.figures.as_of(seen):
        return _serve_campaign(store, seen, latest, again)


def _serve_campaign(store: Store, seen: Campaign, latest: int, again: str | None) -> HTMLResponse:
    # A page that asks again shows its second part already.
    begun = () if again else costs.prefetch_figures(store, seen)
    order = episodes_page.find_failure_order(seen)
    listed = episodes_page.read_failures(store, seen, order)
    first = [row.index for row in listed.items[:MOST_FAILURES]]
    here, lacking = count_present(store), list_unrunnable(store)
    summary = summarise_campaign(store, seen)
    analyses = store.analyses.page(ANALYSES_ON_A_PAGE, None, seen.id).items
    course, rows = find_course(store, seen), store.figures.samples(seen.id)
    world, unit = worlds.world_of(seen.spec.simulator), worlds.find_robustness_unit(seen.spec)
    channels, is_open = world.channels(seen.spec), seen.state not in FINAL_STATES
    minimal = read_minimal_failure(store, seen)
    charts = (
        make_curve_chart(course, unit),
        make_robustness_chart(rows, course, seen.counts.completed, unit),
    )
    view = {
        "campaign": seen,
        "summary": summary,
        "is_open": is_open,
        "remaining": rendering.describe_remaining(seen, summary),
        "next_steps": () if is_open else tuple(list_next_steps(seen, listed.items, analyses)),
        "minimal": minimal,
        "minimal_words": describe_minimal_failure(minimal) if minimal else (),
        "origin": find_origin(seen.spec),
        # Replays are named after the campaign and the episode that they repeat.
        "replays": f"/?{urlencode({'method': REPLAY, 'search': f'replay of {seen.id}/'})}",
        "wants_workers": seen.state in rendering.WORKING and not here,
        "stranded": tuple(each for each in lacking if each.campaign == seen.id),
        "narrow": find_narrow(store, seen, len(here)),
        "mixed": describe_mixed(seen),
        "left_out": world.list_left_out(seen.spec),
        "actions": list_actions(seen),
        "questions": QUESTIONS,
        "tiles": make_tiles(seen, summary, find_reference(store, seen.id, first)),
        "conflicts": make_conflict_tiles(summary) if world.has_road else (),
        "charts": charts if rows else (),
        "failures": episodes_page.make_episode_list(seen, listed, order),
        "analyses": tuple(
            (each, ", ".join(analysis_page.describe_settings(each.settings, channels)))
            for each in analyses
        ),
        "asked": AnalysisSettings(),
        "choices": analysis_page.list_analysis_choices(seen.spec),
        "events": tuple(store.events.latest(EVENTS_SHOWN, seen.id)),
        "times": list_times(seen),
        "priorities": [each for each in Priority if is_open and each is not seen.spec.priority],
        "settings": group_settings(seen),
        "as_of_ms": now_ms(),
        "latest": latest,
    }
    measures = (
        read_measures(seen, costs.read_figures(store, seen))
        if begun and costs.is_prefetched(begun)
        else None
    )
    staffing = partial(make_staffing, store, len(here), lacking)
    response = rendering.page("campaign.html", view, measures=measures, staffing=staffing)
    # The figures are finished after the answer, so that the next request finds them.
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
