"""What the OpenAPI document is told of bodies: one definition of each, the SDK's structs."""

from typing import Any

import msgspec
import numpy as np
from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from eigenfail import __version__
from eigenfail.values import (
    Analysis,
    AnalysisSettings,
    Campaign,
    CampaignCost,
    CampaignSpec,
    Comparison,
    Course,
    Event,
    Explanation,
    FailureMode,
    MinimalFailure,
    Page,
    Policy,
    Proof,
    Region,
    Safety,
    Summary,
)
from eigenfail.values.access import ApiKey, AuditEntry, KeyRequest, NewKey
from eigenfail.values.export import Export, ExportRequest
from eigenfail.values.pool import PeerCosts
from eigenfail.values.priority import PriorityChange
from eigenfail.values.quotas import Quotas, Usage
from eigenfail.values.records import EpisodeDetail, EpisodeRow
from eigenfail.values.report import Report
from eigenfail.values.retention import Pruning
from eigenfail.values.suite import SuiteStanding, SuiteTable
from eigenfail.values.worker import Presence, Staffing, WorkerShare
from eigenfail.wire import http
from eigenfail.wire.drafts import MOST_AT_ONCE, CampaignCheck
from eigenfail.wire.problems import Problem

REF = "#/components/schemas/{name}"
JSON = "application/json"
STREAM = "text/event-stream"
BODIES = (
    Analysis,
    AnalysisSettings,
    ApiKey,
    AuditEntry,
    Campaign,
    CampaignCheck,
    CampaignCost,
    CampaignSpec,
    Comparison,
    Course,
    EpisodeDetail,
    Event,
    Explanation,
    Export,
    ExportRequest,
    KeyRequest,
    MinimalFailure,
    NewKey,
    Page[Analysis],
    Page[ApiKey],
    Page[AuditEntry],
    Page[Campaign],
    Page[EpisodeRow],
    Page[Event],
    Page[FailureMode],
    Page[PeerCosts],
    Page[Pruning],
    Page[Summary],
    Page[Presence],
    Page[WorkerShare],
    Staffing,
    Page[SuiteStanding],
    Page[http.PluginInfo],
    Policy,
    PriorityChange,
    Problem,
    Proof,
    Quotas,
    Region,
    Report,
    Safety,
    SuiteTable,
    Summary,
    Usage,
    http.Digest,
    http.Health,
    http.ProofRequest,
    http.ReplayRequest,
)
NUMBERS = {
    "description": "Numbers, or equally long rows of them: an array, row by row.",
    "type": "array",
    "items": {"anyOf": [{"type": "number"}, {"$ref": REF.format(name="Numbers")}]},
}

FIELDS = {
    "description": "Fields of a CampaignSpec: those that are to be other than they are.",
    "type": "object",
}
SPECS = {
    "type": "array",
    "maxItems": MOST_AT_ONCE,
    "items": {"$ref": REF.format(name="CampaignSpec")},
}


def documented(
    answer: Any, status: int = 200, body: type[msgspec.Struct] | None = None
) -> dict[str, Any]:
    """What OpenAPI is told of a route, as keyword arguments of its decorator.

    Args:
        answer: kind of what it answers with.
        status: with which it answers.
        body: kind of what it is sent.
    """
    told: dict[str, Any] = {
        "status_code": status,
        "responses": {status: {"content": {JSON: schema(answer)}}, "default": refusal()},
    }
    if body is not None:
        request = {"content": {JSON: schema(body)}, "required": bool(required(body))}
        told["openapi_extra"] = {"requestBody": request}
    return told


def documented_plain(answer: Any, status: int, body: dict[str, Any]) -> dict[str, Any]:
    """The same of a route whose body is told by a schema, since no struct stands for it."""
    request = {"content": {JSON: {"schema": body}}, "required": body["type"] == "array"}
    return {**documented(answer, status), "openapi_extra": {"requestBody": request}}


def documented_stream() -> dict[str, Any]:
    """What OpenAPI is told of a stream of events; version 3.1 cannot say more than it is text."""
    told = "Server-sent events. The data of each is the JSON of an Event, its id the Event's id."
    stream = {"schema": {"type": "string", "description": told}}
    return {"responses": {200: {"content": {STREAM: stream}}, "default": refusal()}}


def refusal() -> dict[str, Any]:
    """The answer to whatever cannot be done."""
    return {"description": "A problem.", "content": {http.PROBLEM_JSON: schema(Problem)}}


def required(kind: type[msgspec.Struct]) -> list[str]:
    """The fields of a struct without which it cannot be."""
    return [field.name for field in msgspec.structs.fields(kind) if field.required]


def schema(kind: Any) -> dict[str, Any]:
    """A reference to the component that describes a kind of body."""
    (reference,), _ = msgspec.json.schema_components(
        [kind], schema_hook=array_schema, ref_template=REF
    )
    return {"schema": reference}


def array_schema(kind: type) -> dict[str, Any]:
    """The schema of the kinds that msgspec does not know by itself."""
    known: dict[type, dict[str, Any]] = {np.ndarray: {"$ref": REF.format(name="Numbers")}}
    return known[kind]


def openapi(app: FastAPI) -> dict[str, Any]:
    """The OpenAPI document, made once."""
    if app.openapi_schema is None:
        document = get_openapi(
            title="eigenfail", version=__version__, summary=app.summary, routes=app.routes
        )
        _, components = msgspec.json.schema_components(
            BODIES, schema_hook=array_schema, ref_template=REF
        )
        schemas = document.setdefault("components", {}).setdefault("schemas", {})
        schemas.update(components, Numbers=NUMBERS)
        events = document["paths"][f"{http.PREFIX}/events"]["get"]["responses"]["200"]
        # FastAPI tells of streams in the words of OpenAPI 3.2, under the number 3.1.
        events["content"][STREAM].pop("itemSchema")
        app.openapi_schema = document
    return app.openapi_schema
