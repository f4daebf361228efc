"""The OpenAPI document: schemas of the SDK's structs, and descriptions of routes and answers."""

import re
from collections.abc import Iterator, Mapping, Sequence
from http import HTTPStatus
from types import MappingProxyType
from typing import Any

import msgspec
import numpy as np
from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from eigenfail import __version__, values
from eigenfail.errors import EigenfailError
from eigenfail.gate.report import GateReport
from eigenfail.gate.results import GateResult, GateSummary
from eigenfail.suites import SuiteRequest
from eigenfail.values import webhooks
from eigenfail.values.access import ApiKey, AuditEntry, KeyRequest, NewKey, Quotas, Usage
from eigenfail.values.campaign_spec import PriorityChange
from eigenfail.values.comparison import PeerCosts
from eigenfail.values.estimates import ChainMixing
from eigenfail.values.export import Export, ExportRequest
from eigenfail.values.operations import Presence, Pruning, Staffing, WorkerShare
from eigenfail.values.records import EpisodeDetail, EpisodeRow
from eigenfail.values.release import ReleaseQuestion, ReleaseTable
from eigenfail.values.seeds import SeedSpread
from eigenfail.values.suite import SuiteStanding, SuiteTable
from eigenfail.values.triage import Triage, TriageChange
from eigenfail.wire import http

REF = "#/components/schemas/{name}"
JSON = "application/json"
STREAM = "text/event-stream"
BODIES = (
    values.Analysis,
    values.AnalysisSettings,
    ApiKey,
    AuditEntry,
    values.Campaign,
    http.CampaignCheck,
    values.CampaignCost,
    values.CampaignSpec,
    ChainMixing,
    values.Comparison,
    values.Course,
    EpisodeDetail,
    values.Event,
    values.Explanation,
    Export,
    ExportRequest,
    GateReport,
    GateResult,
    GateSummary,
    KeyRequest,
    values.MinimalFailure,
    NewKey,
    webhooks.NewWebhook,
    values.Page[values.Analysis],
    values.Page[ApiKey],
    values.Page[AuditEntry],
    values.Page[values.Campaign],
    values.Page[EpisodeRow],
    values.Page[values.Event],
    values.Page[values.FailureMode],
    values.Page[GateSummary],
    values.Page[values.Mode],
    values.Mode,
    values.Page[PeerCosts],
    values.Page[Pruning],
    values.Page[SeedSpread],
    values.Page[values.Summary],
    values.Page[Presence],
    values.Page[WorkerShare],
    Staffing,
    values.Page[SuiteStanding],
    values.Page[webhooks.Webhook],
    values.Page[http.PluginInfo],
    values.Policy,
    PriorityChange,
    http.Problem,
    values.Proof,
    Quotas,
    values.Region,
    values.Page[ReleaseQuestion],
    ReleaseTable,
    values.Safety,
    SuiteRequest,
    SuiteTable,
    values.Summary,
    Triage,
    TriageChange,
    Usage,
    webhooks.Webhook,
    webhooks.WebhookDelivery,
    webhooks.WebhookRequest,
    http.Digest,
    http.Health,
    http.ModeName,
    http.ProofRequest,
    http.ReplayRequest,
    http.ShrinkRequest,
)
NUMBERS = {
    "description": "Numbers, or equally long rows of them: an array, row by row.",
    "type": "array",
    "items": {"anyOf": [{"type": "number"}, {"$ref": REF.format(name="Numbers")}]},
}

FIELDS = {
    "description": "Fields of a CampaignSpec, each optional.",
    "type": "object",
}
SPECS = {
    "type": "array",
    "maxItems": http.MAX_CAMPAIGNS_AT_ONCE,
    "items": {"$ref": REF.format(name="CampaignSpec")},
}


def document_route(
    answer: Any, status: int = 200, body: type[msgspec.Struct] | None = None
) -> dict[str, Any]:
    """Return keyword arguments for the decorator of a route that document it.

    Args:
        answer: type of the answer.
        status: status of the answer.
        body: type of the request's body.
    """
    options: dict[str, Any] = {
        "status_code": status,
        "responses": {status: {"content": {JSON: schema(answer)}}, "default": problem_response()},
    }
    if body is not None:
        request = {"content": {JSON: schema(body)}, "required": bool(_required_fields(body))}
        options["openapi_extra"] = {"requestBody": request}
    return options


def document_plain_route(answer: Any, status: int, body: dict[str, Any]) -> dict[str, Any]:
    """Return what `document_route` returns, for a body that has a schema but no struct."""
    request = {"content": {JSON: {"schema": body}}, "required": body["type"] == "array"}
    return {**document_route(answer, status), "openapi_extra": {"requestBody": request}}


def document_stream() -> dict[str, Any]:
    """Return what `document_route` returns, for a stream of events, in OpenAPI 3.1 a text."""
    description = (
        "Server-sent events. The data of each is the JSON of an Event, its id the Event's id."
    )
    stream = {"schema": {"type": "string", "description": description}}
    return {"responses": {200: {"content": {STREAM: stream}}, "default": problem_response()}}


def problem_response() -> dict[str, Any]:
    """Return the description of an answer that is a problem."""
    return {"description": "A problem.", "content": {http.PROBLEM_JSON: schema(http.Problem)}}


def _required_fields(kind: type[msgspec.Struct]) -> list[str]:
    return [field.name for field in msgspec.structs.fields(kind) if field.required]


def schema(kind: Any) -> dict[str, Any]:
    """Return a reference to the component that describes a type."""
    (reference,), _ = msgspec.json.schema_components(
        [kind], schema_hook=_describe_array, ref_template=REF
    )
    return {"schema": reference}


def _describe_array(kind: type) -> dict[str, Any]:
    known: dict[type, dict[str, Any]] = {np.ndarray: {"$ref": REF.format(name="Numbers")}}
    return known[kind]


Node = dict[str, Any]

TAGS = {
    "campaigns": "Budgeted searches for failures: create, follow, steer, summarise, compare.",
    "episodes": "The simulation runs of campaigns.",
    "analyses": "Failures grouped into failure modes, and replays of these modes.",
    "suites": "Named sets of campaigns that run, resume and are judged together.",
    "gates": "Results of regression gates, which `eigenfail gate` judges and reports.",
    "triage": "State, ticket and note of failure modes.",
    "events": "Events as a list or as a stream.",
    "workers": "Processes that run episodes.",
    "plug-ins": "Methods, planners, scenarios and simulators that campaigns can use.",
    "keys": "API keys and the audit log; for administrators.",
    "webhooks": "Addresses to which events are sent; for administrators.",
    "operations": "Liveness, readiness and metrics, for operators.",
}
WORDS = {
    "200": "Success.",
    "201": "Created; `Location` is the address.",
    "202": "Queued; `Location` is the address of the state.",
    "list": "Created.",
}
LOCATION = {
    "description": "Address of the object that was created or queued.",
    "schema": {"type": "string", "format": "uri-reference"},
}
ETAG = {
    "description": "Send as `If-None-Match`: an unchanged answer is 304, without a body. Send as "
    "`If-Match` with a change: it is refused (412) if the answer would be another one.",
    "schema": {"type": "string"},
}
KEY = {
    "type": "http",
    "scheme": "bearer",
    "description": "An API key, `ef_<id>_<secret>`; required once the first key was created.",
}
EXAMPLES: dict[str, Node] = {
    "create_campaign": {"name": "first try", "method": "monte_carlo", "episodes": 100},
    "check_campaign": {"name": "first try", "method": "monte_carlo", "episodes": 100},
    "clone_campaign": {"name": "another seed", "seed": 1},
    "create_key": {"name": "nightly pipeline", "scope": "runner", "expires_s": 7_776_000},
    "create_webhook": {
        "url": "https://hooks.example.org/eigenfail",
        "events": ["campaign.ended", "gate.failed"],
    },
    "record_gate": {
        "gate": {"suite": "nightly", "version": "v2", "run": "nightly @ v2", "baseline": "v1"},
        "open": True,
        "counts": {"fixed": 1},
        "members": [
            {
                "member": "cut-in",
                "known": [{"verdict": "fixed", "what": "medoid 1, 3/115", "was": "3/115"}],
            }
        ],
    },
    "create_analysis": {"components": 20, "clusters": 4},
}
NO_EXAMPLES: Mapping[str, Node] = MappingProxyType({})
EVERYWHERE = (400, 401, 403, 406, 422, 500, 503)
WITH_ID = (404, 409, 410)
WITH_BODY = (409, 410, 413, 415)
OUTDATED = 412
MADE = ("201", "202")

ATTRIBUTE = re.compile(r"(?P<name>\w+): (?P<words>.+)")


def build_document(
    app: FastAPI, bodies: Sequence[Any] = (), examples: Mapping[str, Node] = NO_EXAMPLES
) -> Node:
    """Return the application's OpenAPI document, built at the first call.

    Args:
        app: the application.
        bodies: structs of requests and answers of its extensions.
        examples: examples of bodies of their routes, by the name of the route's function.
    """
    if app.openapi_schema is None:
        document = get_openapi(
            title="eigenfail", version=__version__, summary=app.summary, routes=app.routes
        )
        _, components = msgspec.json.schema_components(
            (*BODIES, *bodies), schema_hook=_describe_array, ref_template=REF
        )
        schemas = document.setdefault("components", {}).setdefault("schemas", {})
        schemas.update(components, Numbers=NUMBERS)
        events = document["paths"][f"{http.PREFIX}/events"]["get"]["responses"]["200"]
        # FastAPI describes streams in the terms of OpenAPI 3.2, under the number 3.1.
        events["content"][STREAM].pop("itemSchema")
        _complete(document, {**EXAMPLES, **examples})
        app.openapi_schema = document
    return app.openapi_schema


def _complete(document: Node, examples: Mapping[str, Node]) -> None:
    """Add descriptions of tags, parameters, answers, refusals and fields."""
    operations = [one for item in document["paths"].values() for one in item.values()]
    used = {tag for operation in operations for tag in operation["tags"]}
    document["tags"] = [
        {"name": tag, "description": words} for tag, words in TAGS.items() if tag in used
    ]
    document["components"]["securitySchemes"] = {"key": KEY}
    refused = sorted({*EVERYWHERE, *WITH_ID, *WITH_BODY, OUTDATED})
    document["components"]["responses"] = {
        str(status): _describe_refusal(status) for status in refused
    }
    for path, item in document["paths"].items():
        for verb, operation in item.items():
            _complete_operation(path, verb, operation)
            if example := examples.get(operation["operationId"]):
                operation["requestBody"]["content"][JSON]["example"] = example
    components = document["components"]["schemas"]
    for name in sorted(components):
        _describe_fields(components[name])
    for kind in (values.Measures, EpisodeRow):
        _describe_measures(components[kind.__name__])


def _complete_operation(path: str, verb: str, operation: Node) -> None:
    operation["summary"] = operation["operationId"].replace("_", " ").capitalize()
    for parameter in operation.get("parameters", []):
        _remove_null(parameter)
    responses = operation["responses"]
    for status, response in responses.items():
        _describe_answer(verb, status, response)
    for status in _list_refusals(path, verb, operation):
        responses.setdefault(str(status), {"$ref": f"#/components/responses/{status}"})
    operation["responses"] = dict(sorted(responses.items()))


def _describe_answer(verb: str, status: str, response: Node) -> None:
    """Add a description and headers to an answer."""
    known = WORDS.get("list" if status in MADE and _is_list(response) else status)
    if known and response.get("description", "") in {"", "Successful Response"}:
        response["description"] = known
    if status in MADE and not _is_list(response):
        response.setdefault("headers", {})["Location"] = LOCATION
    if verb == "get" and status == "200" and [*response.get("content", {})] == [JSON]:
        response.setdefault("headers", {})["ETag"] = ETAG


def _is_list(response: Node) -> bool:
    """Whether an answer is a page, of items with an address each."""
    schema = response["content"][JSON]["schema"]
    return str(schema.get("$ref", "")).rpartition("/")[2].startswith("Page_")


def _list_refusals(path: str, verb: str, operation: Node) -> Iterator[int]:
    """Yield the statuses with which a route may refuse."""
    yield from EVERYWHERE
    if verb != "get":
        yield OUTDATED
    if "{" in path:
        yield from WITH_ID
    if "requestBody" in operation:
        yield from WITH_BODY


def _describe_refusal(status: int) -> Node:
    types = ", ".join(f"`{kind}`" for kind in _list_problem_types(status))
    return {**problem_response(), "description": f"{HTTPStatus(status).phrase}: {types}."}


def _list_problem_types(status: int) -> list[str]:
    kinds = [kind for kind in http.list_error_types(EigenfailError) if kind.http_status == status]
    typed = sorted(http.NAMESPACE + http.slugify(kind) for kind in kinds)
    # Unexpected errors of the service itself have no type.
    return [http.UNTYPED] if not typed or status == http.SERVER_SIDE else typed


def _remove_null(parameter: Node) -> None:
    # None stands for a parameter that was not sent; null cannot be sent.
    kinds = parameter["schema"].get("anyOf", [])
    others = [kind for kind in kinds if kind != {"type": "null"}]
    if len(kinds) > len(others) == 1:
        del parameter["schema"]["anyOf"]
        parameter["schema"] |= others[0]


def _describe_fields(schema: Node) -> None:
    """Move the descriptions of fields from their struct's docstring to the fields."""
    summary, _, attributes = schema.get("description", "").partition("Attributes:\n")
    if summary:
        schema["description"] = " ".join(summary.split())
    for name, words in parse_attributes(attributes):
        if name in schema["properties"]:
            schema["properties"][name].setdefault("description", words)


def _describe_measures(schema: Node) -> None:
    """Add definition and unit of each measure, from its declaration."""
    for name, measure in values.MEASURES.items():
        unit = f" [{measure.unit}]" if measure.unit else ""
        schema["properties"][name].setdefault("description", f"{measure.formula}{unit}.")


def parse_attributes(attributes: str) -> Iterator[tuple[str, str]]:
    """Yield names and descriptions from a docstring's list of attributes."""
    lines = [line.rstrip() for line in attributes.splitlines() if line.strip()]
    margin = min((len(line) - len(line.lstrip()) for line in lines), default=0)
    entries: list[str] = []
    for line in lines:
        if len(line) - len(line.lstrip()) == margin:
            entries.append(line.strip())
        else:
            entries[-1] += f" {line.strip()}"
    found = (ATTRIBUTE.fullmatch(entry) for entry in entries)
    yield from ((match["name"], match["words"]) for match in found if match)
