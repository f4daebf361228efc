"""Routes of campaigns and suites: create, list, steer and summarise."""

from collections.abc import Mapping
from typing import Annotated, Any
from urllib.parse import quote

import msgspec
from fastapi import APIRouter, Depends, Path, Query
from msgspec.structs import replace

from eigenfail.errors import IllegalTransition
from eigenfail.filters import CAMPAIGN_ORDERS, NEWEST_FIRST, parse_campaign_sort
from eigenfail.suites import SuiteRequest
from eigenfail.values.analysis import MinimalFailure
from eigenfail.values.campaign import Campaign, CampaignFilter, CampaignState
from eigenfail.values.campaign_spec import CampaignSpec, PriorityChange
from eigenfail.values.estimates import ChainMixing
from eigenfail.values.learning import Policy
from eigenfail.values.operations import Pruning
from eigenfail.values.records import Page
from eigenfail.values.suite import SuiteStanding, SuiteTable
from eigenfail.values.summary import Course, Summary
from eigenfail.wire.http import PREFIX, CampaignCheck, Digest, ShrinkRequest, make_problem
from eigenfail_api import parameters
from eigenfail_api.concurrency import ConcurrencyLimit
from eigenfail_api.openapi import FIELDS, SPECS, document_route
from eigenfail_services.campaigns import drafts, summary, validation
from eigenfail_services.campaigns.minimal_failures import find_minimal_failure, make_minimal_spec
from eigenfail_services.campaigns.suites import create_suite, read_suite
from eigenfail_services.campaigns.summary import find_chain_mixing
from eigenfail_services.campaigns.validation import fill_defaults
from eigenfail_services.comparison.seeds import make_suite_table
from eigenfail_services.store.store import Store

# Each attempt fails only if the state has changed meanwhile, which does not happen many times in a
# row.
STEERING_ATTEMPTS = 3


class SteeringAction(msgspec.Struct, frozen=True):
    """An action by which users change the state of a campaign.

    Attributes:
        steps: the state that follows each state in which the action is allowed.
        done_in: states in which the action has been taken already, or is under way.
        participle: participle of the verb, for sentences.
    """

    steps: Mapping[CampaignState, CampaignState]
    done_in: frozenset[CampaignState]
    participle: str


PAUSE = SteeringAction(
    steps={
        CampaignState.QUEUED: CampaignState.PAUSED,
        CampaignState.RUNNING: CampaignState.PAUSING,
    },
    done_in=frozenset({CampaignState.PAUSING, CampaignState.PAUSED}),
    participle="paused",
)
RESUME = SteeringAction(
    steps={CampaignState.PAUSED: CampaignState.QUEUED},
    # A request that is repeated may find the campaign running again.
    done_in=frozenset({CampaignState.QUEUED, CampaignState.RUNNING}),
    participle="resumed",
)
# A campaign that waits or is paused ends at once: no worker has an episode of it.
CANCEL = SteeringAction(
    steps={
        CampaignState.QUEUED: CampaignState.CANCELLED,
        CampaignState.PAUSED: CampaignState.CANCELLED,
        CampaignState.RUNNING: CampaignState.CANCELLING,
        CampaignState.PAUSING: CampaignState.CANCELLING,
    },
    done_in=frozenset({CampaignState.CANCELLING, CampaignState.CANCELLED}),
    participle="cancelled",
)


def steer(store: Store, campaign: int, action: SteeringAction) -> Campaign:
    """Take an action on a campaign, unless it was taken before; return the campaign.

    Raises:
        NotFound: no such campaign.
        IllegalTransition: its state does not allow the action.
    """
    for _ in range(STEERING_ATTEMPTS - 1):
        try:
            return _take_step(store, campaign, action)
        except IllegalTransition:
            # The state may have changed between reading and moving: read again.
            continue
    return _take_step(store, campaign, action)


def _take_step(store: Store, campaign: int, action: SteeringAction) -> Campaign:
    found = store.campaigns.get(campaign)
    if found.state in action.done_in:
        return found
    target = action.steps.get(found.state)
    if target is None:
        raise IllegalTransition(
            f"Campaign {campaign} is {found.state} and cannot be {action.participle}.",
            f"Only one that is {' or '.join(action.steps)} can.",
        )
    return store.campaigns.move(campaign, target, "Requested by a user.")


router = APIRouter(prefix=f"{PREFIX}/campaigns", tags=["campaigns"])

Per = Annotated[
    int | None,
    Query(
        ge=1,
        le=parameters.LARGEST,
        description="Episodes in a block; the default depends on the budget.",
    ),
]
Search = Annotated[
    str | None,
    Query(description="Only campaigns whose name contains this text; case is ignored."),
]
Archived = Annotated[bool, Query(description="Whether archived campaigns are listed, too.")]
Fields = Annotated[dict[str, Any], Depends(parameters.plain_body(dict))]
Sort = Annotated[
    str,
    Query(
        max_length=64,
        description=f"Order: {', '.join(CAMPAIGN_ORDERS)}; with a minus, the largest first.",
    ),
]
FIRST_TRY = {"name": "first try", "method": "monte_carlo", "episodes": 100}
Items = Annotated[list[Any], Depends(parameters.plain_body(list))]


def parse_labels(
    project: parameters.Project = None,
    tag: Annotated[str | None, Query(description="Only campaigns with this tag.")] = None,
    planner_version: Annotated[
        str | None, Query(description="Only campaigns of this version of a planner.")
    ] = None,
    archived: Archived = False,
) -> CampaignFilter:
    """Return the part of a request's filter that is about labels, and about the archive."""
    only = None if archived else False
    return CampaignFilter(project=project, tag=tag, planner_version=planner_version, archived=only)


Labels = Annotated[CampaignFilter, Depends(parse_labels)]


def parse_query(
    labels: Labels,
    state: Annotated[CampaignState | None, Query(description="Only in this state.")] = None,
    suite: Annotated[str | None, Query(description="Only campaigns of this suite.")] = None,
    method: Annotated[str | None, Query(description="Only campaigns of this method.")] = None,
    search: Search = None,
) -> CampaignFilter:
    """Return the filter of a request: all its conditions hold."""
    return replace(labels, method=method, search=search, state=state, suite=suite)


def read_page(
    limit: parameters.Limit = 50,
    before: parameters.Before = None,
    with_total: parameters.WithTotal = False,
) -> parameters.PageRequest:
    """Return the page that a request asks for."""
    return parameters.PageRequest(limit, before, with_total)


def _launch(
    store: Store, spec: CampaignSpec, key: str | None, made_by: int | None
) -> parameters.Json:
    wanted = drafts.validate_campaign(spec, store)
    # A repeated request is answered as the first one was, whatever workers are connected now.
    if not store.campaigns.is_key_used(key):
        validation.check_offers(wanted, store.roster.list_offers)
    made = store.campaigns.create(wanted, key, made_by)
    return parameters.Json(made, 201, {"Location": f"{PREFIX}/campaigns/{made.id}"})


@router.post("", **document_route(Campaign, 201, body=CampaignSpec, example=FIRST_TRY))
def create_campaign(
    store: parameters.Stored,
    spec: Annotated[CampaignSpec, Depends(parameters.body_of(CampaignSpec))],
    made_by: parameters.MadeBy,
    idempotency_key: parameters.IdempotencyKey = None,
) -> parameters.Json:
    """Queue a new campaign."""
    return _launch(store, spec, idempotency_key, made_by)


@router.post("/check", **document_route(CampaignCheck, body=FIELDS, example=FIRST_TRY))
def check_campaign(store: parameters.Stored, fields: Fields) -> parameters.Json:
    """Validate a new campaign: its full specification, or all its errors. Nothing is created."""
    if problems := drafts.find_problems(fields, store):
        return parameters.Json(CampaignCheck(None, tuple(map(make_problem, problems))))
    campaign = drafts.read_draft(fields, store)
    notes = tuple(validation.describe_stop_rules(campaign))
    return parameters.Json(CampaignCheck(fill_defaults(campaign.spec), notes=notes))


@router.post("/bulk", **document_route(Page[Campaign], 201, body=SPECS))
def create_campaigns(
    store: parameters.Stored,
    items: Items,
    made_by: parameters.MadeBy,
    idempotency_key: parameters.IdempotencyKey = None,
) -> parameters.Json:
    """Queue new campaigns in the order of the list: all of them, or none."""
    wanted = drafts.read_drafts(items, store)
    if not store.campaigns.is_list_key_used(idempotency_key):
        drafts.check_draft_offers(wanted, store)
    made = store.campaigns.create_many(wanted, idempotency_key, made_by)
    return parameters.Json(Page(made), 201)


@router.get("", **document_route(Page[Campaign]))
def list_campaigns(
    store: parameters.Stored,
    where: Annotated[CampaignFilter, Depends(parse_query)],
    asked: Annotated[parameters.PageRequest, Depends(read_page)],
    sort: Sort = str(NEWEST_FIRST),
) -> parameters.Json:
    """List campaigns in an order, by default newest first."""
    total = store.campaigns.count(where) if asked.with_total else msgspec.UNSET
    found = store.campaigns.page(asked.limit, asked.cursor, where, parse_campaign_sort(sort))
    return parameters.Json(Page(found.items, found.next, total))


# Declared before /{campaign}, which would take the word for an id.
@router.get("/summaries", **document_route(Page[Summary]))
def list_summaries(
    store: parameters.Stored,
    limit: parameters.Limit = 50,
    before: parameters.Before = None,
    archived: Archived = False,
) -> parameters.Json:
    """List failures, failure rate, likelihood and cost of campaigns, newest first."""
    where = CampaignFilter(archived=None if archived else False)
    page = store.campaigns.page(limit, before, where)
    return parameters.Json(Page(tuple(summary.summarise_campaigns(store, page.items)), page.next))


@router.get("/{campaign}", **document_route(Campaign))
def get_campaign(store: parameters.Stored, campaign: parameters.CampaignId) -> parameters.Json:
    """Get a campaign in its current state."""
    return parameters.Json(store.campaigns.get(campaign))


@router.post(
    "/{campaign}/clone",
    **document_route(Campaign, 201, body=FIELDS, example={"name": "another seed", "seed": 1}),
)
def clone_campaign(
    store: parameters.Stored,
    campaign: parameters.CampaignId,
    changes: Fields,
    made_by: parameters.MadeBy,
    idempotency_key: parameters.IdempotencyKey = None,
) -> parameters.Json:
    """Queue a copy of a campaign, with other values for some fields."""
    wanted = drafts.clone(store.campaigns.get(campaign).spec, changes)
    return _launch(store, wanted, idempotency_key, made_by)


def draft_minimal_campaign(
    store: parameters.Stored,
    campaign: parameters.CampaignId,
    index: parameters.EpisodeIndex,
    request: Annotated[ShrinkRequest, Depends(parameters.body_of(ShrinkRequest))],
) -> CampaignSpec:
    """Return the campaign that is to shrink an episode."""
    return make_minimal_spec(store, campaign, index, request.episodes)


@router.post(
    "/{campaign}/episodes/{index}/shrink",
    **document_route(Campaign, 201, body=ShrinkRequest),
)
def shrink_episode(
    store: parameters.Stored,
    wanted: Annotated[CampaignSpec, Depends(draft_minimal_campaign)],
    made_by: parameters.MadeBy,
    idempotency_key: parameters.IdempotencyKey = None,
) -> parameters.Json:
    """Queue a campaign that finds the least noise with which an episode still fails."""
    return _launch(store, wanted, idempotency_key, made_by)


@router.post("/{campaign}/pause", **document_route(Campaign))
def pause_campaign(store: parameters.Stored, campaign: parameters.CampaignId) -> parameters.Json:
    """Pause a campaign; its running episodes are finished and kept."""
    return parameters.Json(steer(store, campaign, PAUSE))


@router.post("/{campaign}/resume", **document_route(Campaign))
def resume_campaign(store: parameters.Stored, campaign: parameters.CampaignId) -> parameters.Json:
    """Resume a paused campaign."""
    return parameters.Json(steer(store, campaign, RESUME))


@router.post("/{campaign}/cancel", **document_route(Campaign))
def cancel_campaign(store: parameters.Stored, campaign: parameters.CampaignId) -> parameters.Json:
    """Cancel a campaign; finished episodes are kept."""
    return parameters.Json(steer(store, campaign, CANCEL))


@router.post("/{campaign}/archive", **document_route(Campaign))
def archive_campaign(store: parameters.Stored, campaign: parameters.CampaignId) -> parameters.Json:
    """Archive a campaign that has ended: lists omit it, and nothing of it is deleted."""
    return parameters.Json(store.campaigns.archive(campaign))


@router.post("/{campaign}/restore", **document_route(Campaign))
def restore_campaign(store: parameters.Stored, campaign: parameters.CampaignId) -> parameters.Json:
    """List an archived campaign again."""
    return parameters.Json(store.campaigns.restore(campaign))


@router.post("/{campaign}/priority", **document_route(Campaign, body=PriorityChange))
def prioritise_campaign(
    store: parameters.Stored,
    campaign: parameters.CampaignId,
    change: Annotated[PriorityChange, Depends(parameters.body_of(PriorityChange))],
) -> parameters.Json:
    """Change the priority of a campaign that has not ended."""
    return parameters.Json(store.campaigns.prioritise(campaign, change.priority))


@router.get("/{campaign}/summary", **document_route(Summary))
def get_summary(store: parameters.Stored, campaign: parameters.CampaignId) -> parameters.Json:
    """Get failures, failure rate, likelihood and cost of a campaign so far."""
    return parameters.Json(summary.summarise_campaign(store, store.campaigns.get(campaign)))


@router.get("/{campaign}/course", **document_route(Course))
def get_course(
    store: parameters.Stored, campaign: parameters.CampaignId, per: Per = None
) -> parameters.Json:
    """Get failures, likelihood and robustness over the episodes of a campaign so far."""
    return parameters.Json(summary.find_course(store, store.campaigns.get(campaign), per))


@router.get("/{campaign}/minimal", **document_route(MinimalFailure))
def get_minimal_failure(
    store: parameters.Stored, campaign: parameters.CampaignId
) -> parameters.Json:
    """Get the smallest noise found to fail, of a campaign that minimises a failure."""
    return parameters.Json(find_minimal_failure(store, store.campaigns.get(campaign)))


@router.get("/{campaign}/mixing", **document_route(ChainMixing))
def get_chain_mixing(store: parameters.Stored, campaign: parameters.CampaignId) -> parameters.Json:
    """Get how far the chains of a campaign have mixed, by R-hat and effective sample size."""
    return parameters.Json(find_chain_mixing(store, store.campaigns.get(campaign)))


@router.get("/{campaign}/digest", **document_route(Digest))
def get_digest(store: parameters.Stored, campaign: parameters.CampaignId) -> parameters.Json:
    """Get the SHA-256 of a campaign's results, by which repeated campaigns are compared."""
    seen = store.campaigns.get(campaign)
    # A campaign that is done has stored its digest; of any other, all results are read.
    digest = seen.digest or store.episodes.digest(campaign)
    episodes = seen.counts.completed + seen.counts.errored
    return parameters.Json(Digest(campaign, digest, episodes, final=seen.digest is not None))


@router.get("/{campaign}/policy", **document_route(Policy))
def get_policy(store: parameters.Stored, campaign: parameters.CampaignId) -> parameters.Json:
    """Get the newest policy that a campaign has trained: raw float32 weights, row by row."""
    return parameters.Json(summary.find_newest_policy(store, store.campaigns.get(campaign)))


@router.get("/{campaign}/prunings", **document_route(Page[Pruning]))
def list_prunings(store: parameters.Stored, campaign: parameters.CampaignId) -> parameters.Json:
    """List the deletions of a campaign's noise by rule, time, user and size, oldest first."""
    # An unknown campaign is a 404, and one without prunings an empty list.
    store.campaigns.get(campaign)
    return parameters.Json(Page(store.retention.of(campaign)))


suites_router = APIRouter(prefix=f"{PREFIX}/suites", tags=["suites"])

SuiteName = Annotated[
    str,
    Path(max_length=200, description='Part of campaign names before the first ": ".'),
]


@suites_router.get("", **document_route(Page[SuiteStanding]))
def list_suites(
    store: parameters.Stored, limit: parameters.Limit = 50, before: parameters.Before = None
) -> parameters.Json:
    """List suites by their newest campaign, newest first; `before` is the id of a campaign."""
    return parameters.Json(store.campaigns.suites(limit, before))


# A suite has up to a thousand members, all of which are checked, so a crowd of requests has to
# wait.
SUITES = Depends(ConcurrencyLimit("suites"), scope="function")


@suites_router.post("", dependencies=[SUITES], **document_route(SuiteTable, 201, body=SuiteRequest))
def create_suite_campaigns(
    store: parameters.Stored,
    given: Annotated[SuiteRequest, Depends(parameters.body_of(SuiteRequest))],
    made_by: parameters.MadeBy,
) -> parameters.Json:
    """Queue the campaigns of a suite that do not exist yet, all or none; get its table."""
    create_suite(store, read_suite(given), made_by)
    location = f"{PREFIX}/suites/{quote(given.name, safe='')}"
    return parameters.Json(make_suite_table(store, given.name), 201, {"Location": location})


# The name of a suite may contain slashes.
@suites_router.get("/{suite:path}", **document_route(SuiteTable))
def get_suite(store: parameters.Stored, suite: SuiteName) -> parameters.Json:
    """Get a suite as a table: the newest campaign of each member, and their differing settings."""
    return parameters.Json(make_suite_table(store, suite))
