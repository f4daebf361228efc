"""Routes of analyses, of the proofs of their failure modes by replay, and of their triage."""

from typing import Annotated

from fastapi import APIRouter, Depends, Query

from eigenfail.errors import InvalidValue
from eigenfail.values.analysis import (
    LONGEST_MODE_NAME,
    Analysis,
    AnalysisSettings,
    FailureMode,
    Mode,
)
from eigenfail.values.comparison import Comparison, PeerCosts
from eigenfail.values.proof import Proof
from eigenfail.values.records import Page
from eigenfail.values.safety import TAIL_LEVEL, Safety
from eigenfail.values.seeds import SeedSpread
from eigenfail.values.summary import CampaignCost
from eigenfail.values.triage import Triage, TriageChange, TriageState, check_change
from eigenfail.wire.http import PREFIX, ModeName, ProofRequest
from eigenfail_api import parameters
from eigenfail_api.concurrency import ConcurrencyLimit
from eigenfail_api.openapi import document_route
from eigenfail_services.campaigns.analysis_jobs import find_basis
from eigenfail_services.campaigns.costs import find_spending
from eigenfail_services.campaigns.proofs import launch_replays, read_result, summarise_proof
from eigenfail_services.campaigns.summary import find_safety
from eigenfail_services.comparison.peers import compare_peers
from eigenfail_services.comparison.seeds import find_spreads
from eigenfail_services.comparison.sides import compare

router = APIRouter(prefix=PREFIX, tags=["analyses"])

OnlyState = Annotated[TriageState | None, Query(description="Only modes in this state of triage.")]


@router.post(
    "/campaigns/{campaign}/analyses",
    **document_route(
        Analysis,
        201,
        body=AnalysisSettings,
        example={"components": 20, "clusters": 4},
    ),
)
def create_analysis(
    store: parameters.Stored,
    campaign: parameters.CampaignId,
    settings: Annotated[AnalysisSettings, Depends(parameters.body_of(AnalysisSettings))],
) -> parameters.Json:
    """Queue an analysis of the failures of a campaign and of further campaigns."""
    # The result is not used: the call refuses now what a job would find out only later.
    find_basis(store, campaign, settings)
    analysis = store.analyses.create(campaign, settings)
    return parameters.Json(analysis, 201, {"Location": f"{PREFIX}/analyses/{analysis.id}"})


@router.get("/campaigns/{campaign}/analyses", **document_route(Page[Analysis]))
def list_analyses(
    store: parameters.Stored,
    campaign: parameters.CampaignId,
    limit: parameters.Limit = 50,
    before: parameters.Before = None,
) -> parameters.Json:
    """List the analyses of a campaign, newest first, without their results."""
    # An unknown campaign is a 404, and one without analyses an empty list.
    store.campaigns.get(campaign)
    return parameters.Json(store.analyses.page(limit, before, campaign))


@router.get("/analyses/{analysis}", **document_route(Analysis))
def get_analysis(store: parameters.Stored, analysis: parameters.AnalysisId) -> parameters.Json:
    """Get an analysis, with its result once it is done."""
    return parameters.Json(store.analyses.get(analysis))


@router.get("/analyses/{analysis}/eigenfailures", **document_route(Page[FailureMode]))
def list_eigenfailures(
    store: parameters.Stored, analysis: parameters.AnalysisId
) -> parameters.Json:
    """List the failure modes of an analysis, each with its eigenfailure."""
    return parameters.Json(Page(read_result(store.analyses.get(analysis)).modes))


@router.get("/analyses/{analysis}/modes", **document_route(Page[Mode]))
def list_modes(
    store: parameters.Stored, analysis: parameters.AnalysisId, state: OnlyState = None
) -> parameters.Json:
    """List the failure modes of an analysis by number, with their names; none before it is done."""
    return parameters.Json(Page(store.analyses.modes(analysis, state)))


@router.put("/analyses/{analysis}/modes/{mode}/name", **document_route(Mode, body=ModeName))
def rename_mode(
    store: parameters.Stored,
    analysis: parameters.AnalysisId,
    mode: parameters.ModeNumber,
    given: Annotated[ModeName, Depends(parameters.body_of(ModeName))],
) -> parameters.Json:
    """Give a failure mode a name."""
    # Names are part of sentences and tables, where line breaks would tear them apart.
    name = " ".join(given.name.split())
    if not name or not name.isprintable():
        problem = "it is empty, or contains a character that cannot be printed."
        raise InvalidValue("name", problem, f"Write up to {LONGEST_MODE_NAME} characters.")
    return parameters.Json(store.analyses.rename_mode(analysis, mode, name))


@router.post("/analyses/{analysis}/proof", **document_route(Proof, 202, body=ProofRequest))
def prove_analysis(
    store: parameters.Stored,
    analysis: parameters.AnalysisId,
    request: Annotated[ProofRequest, Depends(parameters.body_of(ProofRequest))],
    made_by: parameters.MadeBy,
) -> parameters.Json:
    """Queue replays of eigenfailures and medoids in each scenario that has none yet."""
    proven = launch_replays(store, store.analyses.get(analysis), request.variations, made_by)
    return parameters.Json(proven, 202, {"Location": f"{PREFIX}/analyses/{analysis}/proof"})


@router.get("/analyses/{analysis}/proof", **document_route(Proof))
def get_proof(store: parameters.Stored, analysis: parameters.AnalysisId) -> parameters.Json:
    """Get the number of replays that failed again, by scenario, so far."""
    return parameters.Json(summarise_proof(store, store.analyses.get(analysis)))


triage_router = APIRouter(prefix=PREFIX, tags=["triage"])

TRIAGE = "/analyses/{analysis}/modes/{mode}/triage"


async def read_change(
    change: Annotated[TriageChange, Depends(parameters.body_of(TriageChange))],
) -> TriageChange:
    """Return the change of a request, without white space around its texts."""
    return check_change(change)


@triage_router.get(TRIAGE, **document_route(Triage))
def get_mode_triage(
    store: parameters.Stored, analysis: parameters.AnalysisId, mode: parameters.ModeNumber
) -> parameters.Json:
    """Get the triage of a failure mode."""
    return parameters.Json(store.analyses.get_triage(analysis, mode))


@triage_router.post(TRIAGE, **document_route(Triage, body=TriageChange))
def triage_mode(  # noqa: PLR0913, PLR0917 - FastAPI reads a request from the parameters
    store: parameters.Stored,
    analysis: parameters.AnalysisId,
    mode: parameters.ModeNumber,
    change: Annotated[TriageChange, Depends(read_change)],
    who: parameters.CallerName,
    precondition: parameters.Precondition,
) -> parameters.Json:
    """Change the triage of a failure mode; fields that are left out do not change."""
    return parameters.Json(store.analyses.change_triage(analysis, mode, change, who, precondition))


figures_router = APIRouter(prefix=PREFIX, tags=["campaigns"])


# Comparisons and bills read the results of many campaigns, so a crowd of requests is refused.
COMPARISONS = Depends(ConcurrencyLimit("comparisons"), scope="function")


Ids = Annotated[
    str,
    Query(
        pattern=parameters.IDS,
        description="Ids of campaigns, one for each seed, comma-separated.",
        examples=["1"],
    ),
]


SeedIds = Annotated[
    str,
    Query(
        pattern=parameters.MANY_IDS,
        max_length=parameters.LONGEST_IDS,
        description="Ids of campaigns, comma-separated; those that differ in more than the seed "
        "are several groups.",
        examples=["1,2"],
    ),
]


@figures_router.get("/comparisons", dependencies=[COMPARISONS], **document_route(Comparison))
def get_comparison(store: parameters.Stored, a: Ids, b: Ids) -> parameters.Json:
    """Compare failure rates, cost, likelihood and pairs of two campaigns, or of several seeds."""
    return parameters.Json(compare(store, parse_ids(a), parse_ids(b)))


@figures_router.get("/seeds", **document_route(Page[SeedSpread]))
def list_spreads(store: parameters.Stored, campaigns: SeedIds) -> parameters.Json:
    """List mean and spread over seeds of each group of campaigns that differ in their seeds."""
    return parameters.Json(Page(find_spreads(store, parse_ids(campaigns))))


def parse_ids(ids: str) -> tuple[int, ...]:
    """Return the ids in a text that matches the pattern."""
    return tuple(map(int, ids.split(",")))


COSTS = Depends(ConcurrencyLimit("bills"), scope="function")


@figures_router.get("/costs", dependencies=[COSTS], **document_route(Page[PeerCosts]))
def list_costs(store: parameters.Stored) -> parameters.Json:
    """List the cost per failure by method, over all campaigns of one planner and scenario."""
    return parameters.Json(Page(compare_peers(store.figures.pools(), store.campaigns.get)))


@figures_router.get(
    "/campaigns/{campaign}/cost", dependencies=[COSTS], **document_route(CampaignCost)
)
def get_cost(store: parameters.Stored, campaign: parameters.CampaignId) -> parameters.Json:
    """Get the cost of a campaign's failures and modes over time, and how its time was spent."""
    return parameters.Json(find_spending(store, store.campaigns.get(campaign)))


Level = Annotated[float, Query(gt=0.0, lt=1.0, description="Level of VaR and CVaR of severity.")]


@figures_router.get("/campaigns/{campaign}/safety", **document_route(Safety))
def get_safety(
    store: parameters.Stored, campaign: parameters.CampaignId, level: Level = TAIL_LEVEL
) -> parameters.Json:
    """Get collisions, near misses, MinTTC, DRAC and severity of a campaign so far."""
    return parameters.Json(find_safety(store, store.campaigns.get(campaign), level))
