"""Analyses of a campaign's failures, and the proof by replay of what they found."""

from typing import Annotated

from fastapi import APIRouter, Depends

from eigenfail.values import Analysis, AnalysisSettings, FailureMode, Page, Proof
from eigenfail.wire.http import PREFIX, ProofRequest
from eigenfail_api.bodies import Json, body_of
from eigenfail_api.parameters import AnalysisId, Before, CampaignId, Limit, MadeBy, Stored
from eigenfail_api.schemas import documented
from eigenfail_services.campaigns.analysed import ground
from eigenfail_services.campaigns.proofs import findings, proof
from eigenfail_services.campaigns.proving import prove

router = APIRouter(prefix=PREFIX, tags=["analyses"])


@router.post("/campaigns/{campaign}/analyses", **documented(Analysis, 201, body=AnalysisSettings))
def create_analysis(
    store: Stored,
    campaign: CampaignId,
    settings: Annotated[AnalysisSettings, Depends(body_of(AnalysisSettings))],
) -> Json:
    """Queue an analysis of the failures of a campaign, and of others named with it."""
    ground(store, campaign, settings)
    analysis = store.analyses.create(campaign, settings)
    return Json(analysis, 201, {"Location": f"{PREFIX}/analyses/{analysis.id}"})


@router.get("/campaigns/{campaign}/analyses", **documented(Page[Analysis]))
def list_analyses(
    store: Stored, campaign: CampaignId, limit: Limit = 50, before: Before = None
) -> Json:
    """Analyses of a campaign, newest first, without their results."""
    store.campaigns.get(campaign)
    return Json(store.analyses.page(limit, before, campaign))


@router.get("/analyses/{analysis}", **documented(Analysis))
def get_analysis(store: Stored, analysis: AnalysisId) -> Json:
    """An analysis, with its result once it is done."""
    return Json(store.analyses.get(analysis))


@router.get("/analyses/{analysis}/eigenfailures", **documented(Page[FailureMode]))
def list_eigenfailures(store: Stored, analysis: AnalysisId) -> Json:
    """The failure modes, each with its eigenfailure."""
    return Json(Page(findings(store.analyses.get(analysis)).modes))


@router.post("/analyses/{analysis}/proof", **documented(Proof, 202, body=ProofRequest))
def prove_analysis(
    store: Stored,
    analysis: AnalysisId,
    request: Annotated[ProofRequest, Depends(body_of(ProofRequest))],
    made_by: MadeBy,
) -> Json:
    """Queue a replay of eigenfailures and medoids in each scenario that has none yet."""
    proven = prove(store, store.analyses.get(analysis), request.variations, made_by)
    return Json(proven, 202, {"Location": f"{PREFIX}/analyses/{analysis}/proof"})


@router.get("/analyses/{analysis}/proof", **documented(Proof))
def get_proof(store: Stored, analysis: AnalysisId) -> Json:
    """How many replays failed again, in which scenarios, as far as results are in."""
    return Json(proof(store, store.analyses.get(analysis)))
