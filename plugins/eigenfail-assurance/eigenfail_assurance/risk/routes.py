"""The route of the REST API, and what the plug-in adds to the service."""

from typing import Annotated

from fastapi import APIRouter, Depends

from eigenfail.values.access import Scope
from eigenfail.wire.http import PREFIX
from eigenfail_api.dashboard.rendering import NavigationEntry
from eigenfail_api.extensions import Extension
from eigenfail_api.openapi import document_route
from eigenfail_api.parameters import Json, Stored, body_of
from eigenfail_api.routes.analyses import COMPARISONS
from eigenfail_assurance.risk import page
from eigenfail_assurance.risk.assessment import RiskAssessment
from eigenfail_assurance.risk.campaigns import assess_campaigns
from eigenfail_assurance.risk.question import RiskQuestion

router = APIRouter(prefix=PREFIX, tags=["campaigns"])


EXAMPLE = {
    "name": "motorway",
    "target": {"per_hour": 0.001},
    "exposure": {"hours": 1200.0, "kilometres": 96000.0},
    "scenarios": [{"name": "cut-in", "encounters": 340, "campaigns": [1]}],
}


@router.post(
    "/risk",
    dependencies=[COMPARISONS],
    **document_route(RiskAssessment, body=RiskQuestion, example=EXAMPLE),
)
def find_risk(
    store: Stored, question: Annotated[RiskQuestion, Depends(body_of(RiskQuestion))]
) -> Json:
    """Assess the risk of a planner: failures per hour and 10^6 km, against a target."""
    return Json(assess_campaigns(store, question))


extension = Extension(
    routers=(router, page.router),
    templates="eigenfail_assurance",
    navigation=(NavigationEntry("Risk", "/risk"),),
    scopes={Scope.VIEWER: (f"POST {PREFIX}/risk", "POST /risk")},
)
