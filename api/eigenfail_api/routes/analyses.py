"""Routes of analyses, and of the proofs of their failure modes by replay."""

from typing import Annotated

from fastapi import APIRouter, Depends

from eigenfail.values import (
    Analysis,
    AnalysisSettings,
    FailureMode,
    Page,
    Proof,
)
from eigenfail.wire.http import PREFIX, ProofRequest
from eigenfail_api.openapi import document_route
from eigenfail_api.parameters import (
    AnalysisId,
    Before,
    CampaignId,
    Json,
    Limit,
    MadeBy,
    Stored,
    body_of,
)
from eigenfail_services.campaigns.analysis_jobs import find_basis
from eigenfail_services.campaigns.proofs import launch_replays, read_result, summarise_proof

router = APIRouter(prefix=PREFIX, tags=["analyses"])


@router.post(
    "/campaigns/{campaign}/analyses", **document_route(Analysis, 201, body=AnalysisSettings)
)
def create_analysis(
    store: Stored,
    campaign: CampaignId,
    settings: Annotated[AnalysisSettings, Depends(body_of(AnalysisSettings))],
) -> Json:
    """Queue an analysis of the failures of a campaign and of further campaigns."""
    find_basis(store, campaign, settings)
    analysis = store.analyses.create(campaign, settings)
    return Json(analysis, 201, {"Location": f"{PREFIX}/analyses/{analysis.id}"})


@router.get("/campaigns/{campaign}/analyses", **document_route(Page[Analysis]))
def list_analyses(
    store: Stored, campaign: CampaignId, limit: Limit = 50, before: Before = None
) -> Json:
    """List the analyses of a campaign, newest first, without their results."""
    store.campaigns.get(campaign)
    return Json(store.analyses.page(limit, before, campaign))


@router.get("/analyses/{analysis}", **document_route(Analysis))
def get_analysis(store: Stored, analysis: AnalysisId) -> Json:
    """Get an analysis, with its result once it is done."""
    return Json(store.analyses.get(analysis))


@router.get("/analyses/{analysis}/eigenfailures", **document_route(Page[FailureMode]))
def list_eigenfailures(store: Stored, analysis: AnalysisId) -> Json:
    """List the failure modes of an analysis, each with its eigenfailure."""
    return Json(Page(read_result(store.analyses.get(analysis)).modes))


@router.post("/analyses/{analysis}/proof", **document_route(Proof, 202, body=ProofRequest))
def prove_analysis(
    store: Stored,
    analysis: AnalysisId,
    request: Annotated[ProofRequest, Depends(body_of(ProofRequest))],
    made_by: MadeBy,
) -> Json:
    """Queue replays of eigenfailures and medoids in each scenario that has none yet."""
    proven = launch_replays(store, store.analyses.get(analysis), request.variations, made_by)
    return Json(proven, 202, {"Location": f"{PREFIX}/analyses/{analysis}/proof"})


@router.get("/analyses/{analysis}/proof", **document_route(Proof))
def get_proof(store: Stored, analysis: AnalysisId) -> Json:
    """Get the number of replays that failed again, by scenario, so far."""
    return Json(summarise_proof(store, store.analyses.get(analysis)))
