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


def kind_of(schema: Node) -> Kind:
    """The kind of value that a schema describes."""
    value = sample(schema, {})
    text = ",".join(map(str, value)) if isinstance(value, list) else str(value)
    return Kind(words_of(schema), reference_of(schema), text)


def reference_of(schema: Node) -> str:
    """The first schema that is named in another, if there is one."""
    if "$ref" in schema:
        return str(schema["$ref"]).rpartition("/")[2]
    inner = [*schema.get("anyOf", []), item_of(schema)]
    return next(filter(None, map(reference_of, filter(None, inner))), "")


def item_of(schema: Node) -> Node:
    """What the items of an array are; of a fixed number of them, what the first is."""
    first: Node = [*schema.get("prefixItems", []), schema.get("items") or {}][0]
    return first


def words_of(schema: Node) -> str:
    """A schema in words."""
    if "$ref" in schema:
        return reference_of(schema)
    if "anyOf" in schema:
        return " or ".join(map(words_of, schema["anyOf"]))
    if "enum" in schema:
        return " | ".join(map(json.dumps, schema["enum"]))
    if schema.get("type") == "array":
        return f"list of {words_of(item_of(schema))}"
    return " ".join(filter(None, [schema.get("type", "anything"), bounds(schema)]))


def bounds(schema: Node) -> str:
    """The bounds of a number, the length of a text."""
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
        return sample(schemas.get(reference_of(schema), {"type": "object"}), schemas)
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
        return [sample(item_of(schema), schemas)]
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


def reference(document: Node, address: str) -> ReferencePage:
    """The page of a document whose service answers at an address."""
    operations = [*operations_of(document, address)]
    groups = (
        ReferenceGroup(
            tag["name"],
            tag["description"],
            tuple(operation for tags, operation in operations if tag["name"] in tags),
        )
        for tag in document["tags"]
    )
    schemas = document["components"]["schemas"]
    described = tuple(schema_of(name, schemas[name]) for name in sorted(schemas))
    return ReferencePage(tuple(groups), described, address)


def operations_of(document: Node, address: str) -> Iterator[tuple[list[str], Operation]]:
    """All routes with their tags, by their paths."""
    for path, item in sorted(document["paths"].items()):
        for verb, node in item.items():
            yield node["tags"], operation_of(document, f"{verb.upper()} {path}", node, address)


def operation_of(document: Node, place: str, node: Node, address: str) -> Operation:
    """One route; its place is a verb and a path."""
    verb, _, path = place.partition(" ")
    parameters = tuple(map(parameter_of, node.get("parameters", [])))
    body = node.get("requestBody", {}).get("content", {}).get(JSON)
    refusals = document["components"]["responses"]
    answers = tuple(
        answer_of(status, refusals[each["$ref"].rpartition("/")[2]] if "$ref" in each else each)
        for status, each in node["responses"].items()
    )
    accept = answers[0].contents[0][0] if answers[0].contents else ""
    return Operation(
        id=node["operationId"],
        verb=verb,
        path=path,
        words=node["description"],
        parameters=parameters,
        body=kind_of(body["schema"]) if body else None,
        answers=answers,
        curl=curl(verb, address + path, parameters, body_example(document, body)),
        accept=accept,
        can_try=verb == "GET" and accept != STREAM,
    )


def parameter_of(node: Node) -> ReferenceField:
    """A parameter of a route."""
    kind, default = kind_of(node["schema"]), default_of(node["schema"])
    words = node.get("description", "")
    return ReferenceField(
        node["name"], node["in"], kind, node.get("required", False), default, words
    )


def answer_of(status: str, node: Node) -> Answer:
    """One of the answers of a route."""
    contents = node.get("content", {}).items()
    kinds = tuple((media, kind_of(each["schema"])) for media, each in contents)
    is_problem = any("problem" in media for media, _ in kinds)
    status = "other" if status == "default" else status
    return Answer(status, node["description"], kinds, is_problem)


def schema_of(name: str, schema: Node) -> Schema:
    """A schema with its fields."""
    needed = schema.get("required", [])
    fields = (
        ReferenceField(
            each, "", kind_of(part), each in needed, default_of(part), part.get("description", "")
        )
        for each, part in schema.get("properties", {}).items()
    )
    return Schema(
        name, " ".join(schema.get("description", "").split()), kind_of(schema), tuple(fields)
    )


def default_of(schema: Node) -> str:
    """What stands for a value that is not sent, as JSON; empty if there is no such thing."""
    return json.dumps(schema["default"]) if "default" in schema else ""


def body_example(document: Node, body: Node | None) -> str:
    """A small body that is in order, as JSON; empty if there is none."""
    if body is None:
        return ""
    found = body.get("example", sample(body["schema"], document["components"]["schemas"]))
    return json.dumps(found)


def curl(verb: str, url: str, parameters: tuple[ReferenceField, ...], body: str) -> str:
    """A command line that asks for it, with sample ids in the place of path parameters."""
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
    return page("api.html", reference(request.app.openapi(), address))


@router.get("/glossary")
def show_glossary() -> HTMLResponse:
    """Show all terms with their definitions and units."""
    return page("glossary.html", read_glossary())
