"""Routes of triage: state, ticket and note of failure modes."""

from typing import Annotated

from fastapi import APIRouter, Depends

from eigenfail.values.triage import Triage, TriageChange, check_change
from eigenfail.wire.http import PREFIX
from eigenfail_api import parameters
from eigenfail_api.openapi import document_route

router = APIRouter(prefix=PREFIX, tags=["triage"])

ADDRESS = "/analyses/{analysis}/modes/{mode}/triage"


async def read_change(
    change: Annotated[TriageChange, Depends(parameters.body_of(TriageChange))],
) -> TriageChange:
    """Return the change of a request, without white space around its texts."""
    return check_change(change)


@router.get(ADDRESS, **document_route(Triage))
def get_mode_triage(
    store: parameters.Stored, analysis: parameters.AnalysisId, mode: parameters.ModeNumber
) -> parameters.Json:
    """Get the triage of a failure mode."""
    return parameters.Json(store.analyses.get_triage(analysis, mode))


@router.post(ADDRESS, **document_route(Triage, body=TriageChange))
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
