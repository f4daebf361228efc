"""The OpenAPI document: schemas of the SDK's structs, and descriptions of routes and answers."""

import re
from collections.abc import Iterator
from http import HTTPStatus
from typing import Any

import msgspec
import numpy as np
from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from fastapi.routing import APIRoute, iter_route_contexts

from eigenfail import __version__
from eigenfail.errors import EigenfailError
from eigenfail.values.measures import MEASURES, Measures
from eigenfail.values.records import EpisodeRow
from eigenfail.wire import http

REF = "#/components/schemas/{name}"
JSON = "application/json"
STREAM = "text/event-stream"
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


Node = dict[str, Any]


class TypeReference(dict[str, Any]):
    """Reference to the component that describes a type, with the type itself.

    FastAPI keeps the answers and bodies that a route declares. So the routes contain the types
    that the document has to describe.

    Args:
        kind: type that msgspec can encode.
    """

    def __init__(self, kind: Any) -> None:
        (reference,), _ = _describe_types([kind])
        super().__init__(reference)
        self.kind = kind


def _describe_types(kinds: list[Any]) -> tuple[tuple[Node, ...], Node]:
    """Return the reference to each type, and the components that describe them, by name."""

    def describe_array(kind: type) -> Node:
        # A new object for each field: `_describe_fields` writes the field's description into it.
        arrays: dict[type, Node] = {np.ndarray: {"$ref": REF.format(name="Numbers")}}
        return arrays[kind]

    return msgspec.json.schema_components(kinds, schema_hook=describe_array, ref_template=REF)


def schema(kind: Any) -> Node:
    """Return the description of content that is of a type."""
    return {"schema": TypeReference(kind)}


def document_route(
    answer: Any,
    status: int = 200,
    body: type[msgspec.Struct] | Node | None = None,
    example: Node | None = None,
) -> Node:
    """Return keyword arguments for the decorator of a route that document it.

    Args:
        answer: type of the answer.
        status: status of the answer.
        body: type of the request's body; or the schema of a body that no struct describes.
        example: example of the request's body.
    """
    options: Node = {
        "status_code": status,
        "responses": {status: {"content": {JSON: schema(answer)}}, "default": problem_response()},
    }
    if body is None:
        return options
    if isinstance(body, dict):
        content, required = {"schema": body}, body["type"] == "array"
    else:
        content = schema(body)
        required = any(field.required for field in msgspec.structs.fields(body))
    if example is not None:
        content["example"] = example
    options["openapi_extra"] = {"requestBody": {"content": {JSON: content}, "required": required}}
    return options


def document_stream() -> Node:
    """Return what `document_route` returns, for a stream of events, in OpenAPI 3.1 a text."""
    description = (
        "Server-sent events. The data of each is the JSON of an Event, its id the Event's id."
    )
    stream = {"schema": {"type": "string", "description": description}}
    return {"responses": {200: {"content": {STREAM: stream}}, "default": problem_response()}}


def document_file(media_type: str) -> Node:
    """Return what `document_route` returns, for a file of a media type."""
    content = {media_type: {"schema": {"type": "string", "format": "binary"}}}
    return {"responses": {200: {"content": content}, "default": problem_response()}}


def problem_response() -> Node:
    """Return the description of an answer that is a problem."""
    return {"description": "A problem.", "content": {http.PROBLEM_JSON: schema(http.Problem)}}


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
EVERYWHERE = (400, 401, 403, 406, 422, 500, 503)
WITH_ID = (404, 409, 410)
WITH_BODY = (409, 410, 413, 415)
OUTDATED = 412
MADE = ("201", "202")

ATTRIBUTE = re.compile(r"(?P<name>\w+): (?P<words>.+)")


def build_document(app: FastAPI) -> Node:
    """Return the application's OpenAPI document, built at the first call."""
    if app.openapi_schema is None:
        document = get_openapi(
            title="eigenfail", version=__version__, summary=app.summary, routes=app.routes
        )
        kinds: list[Any] = []
        for context in iter_route_contexts(app.routes):
            route = context.original_route
            if isinstance(route, APIRoute) and route.include_in_schema:
                kinds += _list_types(route.responses)
                kinds += _list_types(route.openapi_extra)
        _, components = _describe_types(kinds)
        schemas = {**document["components"]["schemas"], **components, "Numbers": NUMBERS}
        # Sorted, so that a route that moves changes no line of docs/openapi.json but its own.
        document["components"]["schemas"] = dict(sorted(schemas.items()))
        events = document["paths"][f"{http.PREFIX}/events"]["get"]["responses"]["200"]
        # FastAPI describes streams in the terms of OpenAPI 3.2, under the number 3.1.
        events["content"][STREAM].pop("itemSchema")
        _complete(document)
        app.openapi_schema = document
    return app.openapi_schema


def _list_types(node: Any) -> Iterator[Any]:
    """Yield the types that a description refers to, once for each reference."""
    if isinstance(node, TypeReference):
        yield node.kind
    elif isinstance(node, dict):
        for below in node.values():
            yield from _list_types(below)


def _complete(document: Node) -> None:
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
    components = document["components"]["schemas"]
    for component in components.values():
        _describe_fields(component)
    for kind in (Measures, EpisodeRow):
        # Definition and unit of each measure are declared once, for pages and tables as well.
        described = components[kind.__name__]["properties"]
        for name, measure in MEASURES.items():
            unit = f" [{measure.unit}]" if measure.unit else ""
            described[name].setdefault("description", f"{measure.formula}{unit}.")


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
    """Return whether an answer is a page of items, which each have an address."""
    schema = response["content"][JSON]["schema"]
    return str(schema.get("$ref", "")).rpartition("/")[2].startswith("Page_")


def _list_refusals(path: str, verb: str, operation: Node) -> Iterator[int]:
    """Yield the status codes of a route's possible refusals."""
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
