"""Analyses of a campaign's failures, and replays of what they found."""

from typing import Annotated

import msgspec
from fastapi import APIRouter, Depends

from eigenfail.contracts import Store
from eigenfail.errors import Conflict
from eigenfail.values import (
    Analysis,
    AnalysisResult,
    AnalysisSettings,
    Campaign,
    CampaignSpec,
    FailureMode,
    Page,
    StopRules,
)
from eigenfail.wire.http import PREFIX, ReplayRequest
from eigenfail_api.parameters import (
    AnalysisId,
    Before,
    CampaignId,
    IdempotencyKey,
    Limit,
    Stored,
)
from eigenfail_api.routes.campaigns import created
from eigenfail_api.schemas import Json, body_of, documented
from eigenfail_services.campaigns.checks import check_spec

router = APIRouter(prefix=PREFIX, tags=["analyses"])

MAX_NAME = 200


@router.post("/campaigns/{campaign}/analyses", **documented(Analysis, 201, body=AnalysisSettings))
def create_analysis(
    store: Stored,
    campaign: CampaignId,
    settings: Annotated[AnalysisSettings, Depends(body_of(AnalysisSettings))],
) -> Json:
    """Queue an analysis of a campaign's failures."""
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
    return Json(Page(found(store.analyses.get(analysis)).modes))


@router.post("/analyses/{analysis}/replay", **documented(Campaign, 201, body=ReplayRequest))
def replay_analysis(
    store: Stored,
    analysis: AnalysisId,
    request: Annotated[ReplayRequest, Depends(body_of(ReplayRequest))],
    idempotency_key: IdempotencyKey = None,
) -> Json:
    """Queue a campaign that injects the eigenfailures, one episode each."""
    spec = replay_of(store, store.analyses.get(analysis), request)
    campaign = store.campaigns.create(check_spec(spec), idempotency_key)
    store.analyses.link_replay(analysis, campaign.id)
    return created(campaign)


def replay_of(store: Store, analysis: Analysis, request: ReplayRequest) -> CampaignSpec:
    """The campaign that replays an analysis in the world of the campaign it analysed.

    Raises:
        Conflict: the analysis is not done, or found no failure mode.
    """
    modes = found(analysis).modes
    if not modes:
        raise Conflict(
            f"Analysis {analysis.id} found no failure mode, so there is nothing to replay.",
            "Let the campaign run until it has failures, and analyse it again.",
        )
    analysed = store.campaigns.get(analysis.campaign).spec
    name = f"{analysed.name}: eigenfailures of analysis {analysis.id}"
    return msgspec.structs.replace(
        analysed,
        name=request.name or name[-MAX_NAME:],
        method="replay",
        settings={"analysis": analysis.id},
        episodes=len(modes),
        stop=StopRules(),
        scenario_parameters={**analysed.scenario_parameters, **request.scenario_parameters},
        scene_every=1,
    )


def found(analysis: Analysis) -> AnalysisResult:
    """What an analysis found.

    Raises:
        Conflict: it is not done.
    """
    if analysis.result is None:
        raise Conflict(
            f"Analysis {analysis.id} is {analysis.state}. {analysis.problem}".strip(),
            "Wait until it is done, or launch another.",
        )
    return analysis.result
