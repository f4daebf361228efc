"""Routes of versions of planners: their comparison, and the reports of gates."""

from typing import Annotated

from fastapi import APIRouter, Depends, Path

from eigenfail.gate.report import GateReport
from eigenfail.gate.results import GateResult, GateSummary, check_report
from eigenfail.values.records import Page
from eigenfail.values.release import ReleaseQuestion, ReleaseTable
from eigenfail.wire.http import PREFIX
from eigenfail_api import parameters
from eigenfail_api.concurrency import ConcurrencyLimit
from eigenfail_api.openapi import document_route
from eigenfail_services.comparison.releases import list_tested_worlds, make_release_table

router = APIRouter(prefix=PREFIX, tags=["campaigns"])

# Both routes read up to 2,000 campaigns, so a crowd of requests is refused.
RELEASES = Depends(ConcurrencyLimit("releases"), scope="function")


@router.get("/releases", dependencies=[RELEASES], **document_route(Page[ReleaseQuestion]))
def list_releases(store: parameters.Stored, project: parameters.Project = None) -> parameters.Json:
    """List the scenarios in which versions of a planner were tested, the newest first."""
    return parameters.Json(Page(list_tested_worlds(store, project)))


@router.get("/releases/{campaign}", dependencies=[RELEASES], **document_route(ReleaseTable))
def get_release_table(store: parameters.Stored, campaign: parameters.CampaignId) -> parameters.Json:
    """Get the versions tested as in a campaign, with what became of each failure mode."""
    return parameters.Json(make_release_table(store, campaign))


gates_router = APIRouter(prefix=PREFIX, tags=["gates"])

GateId = Annotated[
    int, Path(ge=1, le=parameters.LARGEST, description="Id of the result of a gate.")
]


EXAMPLE = {
    "gate": {"suite": "nightly", "version": "v2", "run": "nightly @ v2", "baseline": "v1"},
    "open": True,
    "counts": {"fixed": 1},
    "members": [
        {
            "member": "cut-in",
            "known": [{"verdict": "fixed", "what": "medoid 1, 3/115", "was": "3/115"}],
        }
    ],
}


@gates_router.post("/gates", **document_route(GateSummary, 201, body=GateReport, example=EXAMPLE))
def record_gate(
    store: parameters.Stored, report: Annotated[GateReport, Depends(parameters.body_of(GateReport))]
) -> parameters.Json:
    """Store the report of a gate once, and log its verdict."""
    check_report(report)
    made = store.gates.record(report)
    return parameters.Json(made, 201, {"Location": f"{PREFIX}/gates/{made.id}"})


@gates_router.get("/gates", **document_route(Page[GateSummary]))
def list_gates(
    store: parameters.Stored, limit: parameters.Limit = 50, before: parameters.Before = None
) -> parameters.Json:
    """List the results of gates, newest first, without their reports."""
    return parameters.Json(store.gates.page(limit, before))


@gates_router.get("/gates/{gate}", **document_route(GateResult))
def get_gate(store: parameters.Stored, gate: GateId) -> parameters.Json:
    """Get the result of a gate, with its report."""
    return parameters.Json(store.gates.get(gate))
