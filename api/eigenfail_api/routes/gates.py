"""Routes of gates: reports that clients send, as the service keeps them."""

from typing import Annotated

from fastapi import APIRouter, Depends, Path

from eigenfail.gate.report import GateReport
from eigenfail.gate.results import GateResult, GateSummary, check_report
from eigenfail.values.records import Page
from eigenfail.wire.http import PREFIX
from eigenfail_api.openapi import document_route
from eigenfail_api.parameters import LARGEST, Before, Json, Limit, Stored, body_of

router = APIRouter(prefix=PREFIX, tags=["gates"])

GateId = Annotated[int, Path(ge=1, le=LARGEST, description="Id of the result of a gate.")]


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


@router.post("/gates", **document_route(GateSummary, 201, body=GateReport, example=EXAMPLE))
def record_gate(store: Stored, report: Annotated[GateReport, Depends(body_of(GateReport))]) -> Json:
    """Store the report of a gate once, and log its verdict."""
    check_report(report)
    made = store.gates.record(report)
    return Json(made, 201, {"Location": f"{PREFIX}/gates/{made.id}"})


@router.get("/gates", **document_route(Page[GateSummary]))
def list_gates(store: Stored, limit: Limit = 50, before: Before = None) -> Json:
    """List the results of gates, newest first, without their reports."""
    return Json(store.gates.page(limit, before))


@router.get("/gates/{gate}", **document_route(GateResult))
def get_gate(store: Stored, gate: GateId) -> Json:
    """Get the result of a gate, with its report."""
    return Json(store.gates.get(gate))
