"""The reference of the REST API, and the glossary."""

import json
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse

from eigenfail_api.dashboard.rendering import page, read_glossary

router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)


Node = dict[str, Any]

LARGE = 10**15
"""A bound beyond this says how numbers are stored, and nothing to a reader."""

SAMPLES: dict[str, Any] = {
    "integer": 1,
    "number": 1.0,
    "string": "name",
    "boolean": False,
    "array": [],
    "object": {},
    "null": None,
}


class Kind(NamedTuple):
    """What a value is: in words, the schema that it names if there is one, a value for a URL."""

    words: str
    reference: str
    sample: str


def find_kind(schema: Node) -> Kind:
    """Return the kind of value that a schema describes."""
    value = sample(schema, {})
    text = ",".join(map(str, value)) if isinstance(value, list) else str(value)
    return Kind(describe_schema(schema), find_reference(schema), text)


def find_reference(schema: Node) -> str:
    """Return the name of the first schema that a schema refers to; empty if there is none."""
    if "$ref" in schema:
        return str(schema["$ref"]).rpartition("/")[2]
    inner = [*schema.get("anyOf", []), find_item(schema)]
    return next(filter(None, map(find_reference, filter(None, inner))), "")


def find_item(schema: Node) -> Node:
    """Return the schema of an array's items; of the first item for a fixed number of items."""
    first: Node = [*schema.get("prefixItems", []), schema.get("items") or {}][0]
    return first


def describe_schema(schema: Node) -> str:
    """Return a schema as text."""
    if "$ref" in schema:
        return find_reference(schema)
    if "anyOf" in schema:
        return " or ".join(map(describe_schema, schema["anyOf"]))
    if "enum" in schema:
        return " | ".join(map(json.dumps, schema["enum"]))
    if schema.get("type") == "array":
        return f"list of {describe_schema(find_item(schema))}"
    return " ".join(filter(None, [schema.get("type", "anything"), describe_bounds(schema)]))


def describe_bounds(schema: Node) -> str:
    """Return the bounds of a number, or the length of a text."""
    phrases = [
        f"{sign} {schema[name]}"
        for name, sign in (
            ("minimum", "≥"),
            ("exclusiveMinimum", ">"),
            ("maximum", "≤"),
            ("exclusiveMaximum", "<"),
        )
        if abs(schema.get(name, LARGE)) < LARGE
    ]
    if "maxLength" in schema:
        phrases.append(f"of at most {schema['maxLength']} characters")
    return ", ".join(phrases)


def sample(schema: Node, schemas: Mapping[str, Node]) -> Any:
    """A small value that is in order; a schema that is not among the named ones is any object."""
    if "$ref" in schema:
        return sample(schemas.get(find_reference(schema), {"type": "object"}), schemas)
    given = [schema[name] for name in ("default", "const") if name in schema]
    for value in [*schema.get("examples", []), *given, *schema.get("enum", [])]:
        return value
    if "anyOf" in schema:
        return sample(schema["anyOf"][0], schemas)
    return sample_of_type(schema, schemas)


def sample_of_type(schema: Node, schemas: Mapping[str, Node]) -> Any:
    """Return a sample value for a schema that gives only a type."""
    inner = schema.get("properties", {})
    if inner:
        return {name: sample(inner[name], schemas) for name in schema.get("required", [])}
    if schema.get("minItems"):
        return [sample(find_item(schema), schemas)]
    return schema.get("minimum", SAMPLES[schema.get("type", "object")])


JSON = "application/json"
STREAM = "text/event-stream"


class ReferenceField(NamedTuple):
    """A parameter of a route, or a field of a schema; `where` is path, query, header or empty."""

    name: str
    where: str
    kind: Kind
    is_required: bool
    default: str
    words: str


class Answer(NamedTuple):
    """What may come back: the kinds of content, each with its schema."""

    status: str
    words: str
    contents: tuple[tuple[str, Kind], ...]
    is_problem: bool


class Operation(NamedTuple):
    """One verb at one address."""

    id: str
    verb: str
    path: str
    words: str
    parameters: tuple[ReferenceField, ...]
    body: Kind | None
    answers: tuple[Answer, ...]
    curl: str
    accept: str
    can_try: bool


class ReferenceGroup(NamedTuple):
    """The routes of a tag."""

    name: str
    words: str
    operations: tuple[Operation, ...]


class Schema(NamedTuple):
    """A body, or a part of one."""

    name: str
    words: str
    kind: Kind
    fields: tuple[ReferenceField, ...]


class ReferencePage(NamedTuple):
    """The whole page."""

    groups: tuple[ReferenceGroup, ...]
    schemas: tuple[Schema, ...]
    address: str


def make_reference(document: Node, address: str) -> ReferencePage:
    """Return the reference page of a document whose service has an address."""
    operations = [*iterate_operations(document, address)]
    groups = (
        ReferenceGroup(
            tag["name"],
            tag["description"],
            tuple(operation for tags, operation in operations if tag["name"] in tags),
        )
        for tag in document["tags"]
    )
    schemas = document["components"]["schemas"]
    described = tuple(make_schema(name, schemas[name]) for name in sorted(schemas))
    return ReferencePage(tuple(groups), described, address)


def iterate_operations(document: Node, address: str) -> Iterator[tuple[list[str], Operation]]:
    """Yield all routes with their tags, in the order of their paths."""
    for path, item in sorted(document["paths"].items()):
        for verb, node in item.items():
            yield node["tags"], make_operation(document, f"{verb.upper()} {path}", node, address)


def make_operation(document: Node, place: str, node: Node, address: str) -> Operation:
    """Return a route; its place is a verb and a path."""
    verb, _, path = place.partition(" ")
    parameters = tuple(map(make_parameter, node.get("parameters", [])))
    body = node.get("requestBody", {}).get("content", {}).get(JSON)
    refusals = document["components"]["responses"]
    answers = tuple(
        make_answer(status, refusals[each["$ref"].rpartition("/")[2]] if "$ref" in each else each)
        for status, each in node["responses"].items()
    )
    accept = answers[0].contents[0][0] if answers[0].contents else ""
    return Operation(
        id=node["operationId"],
        verb=verb,
        path=path,
        words=node["description"],
        parameters=parameters,
        body=find_kind(body["schema"]) if body else None,
        answers=answers,
        curl=format_curl(verb, address + path, parameters, make_body_example(document, body)),
        accept=accept,
        can_try=verb == "GET" and accept != STREAM,
    )


def make_parameter(node: Node) -> ReferenceField:
    """Return a parameter of a route."""
    kind, default = find_kind(node["schema"]), read_default(node["schema"])
    words = node.get("description", "")
    return ReferenceField(
        node["name"], node["in"], kind, node.get("required", False), default, words
    )


def make_answer(status: str, node: Node) -> Answer:
    """Return a response of a route."""
    contents = node.get("content", {}).items()
    kinds = tuple((media, find_kind(each["schema"])) for media, each in contents)
    is_problem = any("problem" in media for media, _ in kinds)
    status = "other" if status == "default" else status
    return Answer(status, node["description"], kinds, is_problem)


def make_schema(name: str, schema: Node) -> Schema:
    """Return a schema with its fields."""
    needed = schema.get("required", [])
    fields = (
        ReferenceField(
            each,
            "",
            find_kind(part),
            each in needed,
            read_default(part),
            part.get("description", ""),
        )
        for each, part in schema.get("properties", {}).items()
    )
    return Schema(
        name, " ".join(schema.get("description", "").split()), find_kind(schema), tuple(fields)
    )


def read_default(schema: Node) -> str:
    """Return the value of a parameter that is not sent, as JSON; empty if there is none."""
    return json.dumps(schema["default"]) if "default" in schema else ""


def make_body_example(document: Node, body: Node | None) -> str:
    """Return a small valid body, as JSON; empty if there is none."""
    if body is None:
        return ""
    found = body.get("example", sample(body["schema"], document["components"]["schemas"]))
    return json.dumps(found)


def format_curl(verb: str, url: str, parameters: tuple[ReferenceField, ...], body: str) -> str:
    """Return the shell command of a request, with sample ids for path parameters."""
    for parameter in parameters:
        if parameter.where == "path":
            url = url.replace(f"{{{parameter.name}}}", parameter.kind.sample)
    needed = [each for each in parameters if each.where == "query" and each.is_required]
    query = "&".join(f"{each.name}={each.kind.sample}" for each in needed)
    sent = f" \\\n  -H 'Content-Type: {JSON}' \\\n  -d '{body}'" if body else ""
    how = "" if verb == "GET" else f" -X {verb}"
    return f"curl{how} '{url}{'?' if query else ''}{query}'{sent}"


@router.get("/api")
def show_api(request: Request) -> HTMLResponse:
    """All routes with their parameters, answers and an example; those that read can be tried."""
    address = str(request.base_url).rstrip("/")
    return page("api.html", make_reference(request.app.openapi(), address))


@router.get("/glossary")
def show_glossary() -> HTMLResponse:
    """Show all terms with their definitions and units."""
    return page("glossary.html", read_glossary())
