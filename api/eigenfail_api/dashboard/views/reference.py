"""The OpenAPI document as a page shows it: routes by tag, and the schemas that they name."""

import json
from collections.abc import Iterator
from typing import Any, NamedTuple

from eigenfail_api.dashboard.views.kinds import Kind, kind_of, sample

Node = dict[str, Any]

JSON = "application/json"
STREAM = "text/event-stream"


class Field(NamedTuple):
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
    parameters: tuple[Field, ...]
    body: Kind | None
    answers: tuple[Answer, ...]
    curl: str
    accept: str
    can_try: bool


class Group(NamedTuple):
    """The routes of a tag."""

    name: str
    words: str
    operations: tuple[Operation, ...]


class Schema(NamedTuple):
    """A body, or a part of one."""

    name: str
    words: str
    kind: Kind
    fields: tuple[Field, ...]


class Reference(NamedTuple):
    """The whole page."""

    groups: tuple[Group, ...]
    schemas: tuple[Schema, ...]
    address: str


def reference(document: Node, address: str) -> Reference:
    """The page of a document whose service answers at an address."""
    operations = [*operations_of(document, address)]
    groups = (
        Group(
            tag["name"],
            tag["description"],
            tuple(operation for tags, operation in operations if tag["name"] in tags),
        )
        for tag in document["tags"]
    )
    schemas = document["components"]["schemas"]
    told = tuple(schema_of(name, schemas[name]) for name in sorted(schemas))
    return Reference(tuple(groups), told, address)


def operations_of(document: Node, address: str) -> Iterator[tuple[list[str], Operation]]:
    """All routes with their tags, by their paths."""
    for path, item in sorted(document["paths"].items()):
        for verb, told in item.items():
            yield told["tags"], operation_of(document, f"{verb.upper()} {path}", told, address)


def operation_of(document: Node, place: str, told: Node, address: str) -> Operation:
    """One route; its place is a verb and a path."""
    verb, _, path = place.partition(" ")
    parameters = tuple(map(parameter_of, told.get("parameters", [])))
    body = told.get("requestBody", {}).get("content", {}).get(JSON)
    refusals = document["components"]["responses"]
    answers = tuple(
        answer_of(status, refusals[each["$ref"].rpartition("/")[2]] if "$ref" in each else each)
        for status, each in told["responses"].items()
    )
    accept = answers[0].contents[0][0] if answers[0].contents else ""
    return Operation(
        id=told["operationId"],
        verb=verb,
        path=path,
        words=told["description"],
        parameters=parameters,
        body=kind_of(body["schema"]) if body else None,
        answers=answers,
        curl=curl(verb, address + path, parameters, body_example(document, body)),
        accept=accept,
        can_try=verb == "GET" and accept != STREAM,
    )


def parameter_of(told: Node) -> Field:
    """A parameter of a route."""
    kind, default = kind_of(told["schema"]), default_of(told["schema"])
    words = told.get("description", "")
    return Field(told["name"], told["in"], kind, told.get("required", False), default, words)


def answer_of(status: str, told: Node) -> Answer:
    """One of the answers of a route."""
    contents = told.get("content", {}).items()
    kinds = tuple((media, kind_of(each["schema"])) for media, each in contents)
    is_problem = any("problem" in media for media, _ in kinds)
    status = "other" if status == "default" else status
    return Answer(status, told["description"], kinds, is_problem)


def schema_of(name: str, told: Node) -> Schema:
    """A schema with its fields."""
    needed = told.get("required", [])
    fields = (
        Field(
            each, "", kind_of(node), each in needed, default_of(node), node.get("description", "")
        )
        for each, node in told.get("properties", {}).items()
    )
    return Schema(name, " ".join(told.get("description", "").split()), kind_of(told), tuple(fields))


def default_of(schema: Node) -> str:
    """What stands for a value that is not sent, as JSON; empty if there is no such thing."""
    return json.dumps(schema["default"]) if "default" in schema else ""


def body_example(document: Node, body: Node | None) -> str:
    """A small body that is in order, as JSON; empty if there is none."""
    if body is None:
        return ""
    found = body.get("example", sample(body["schema"], document["components"]["schemas"]))
    return json.dumps(found)


def curl(verb: str, url: str, parameters: tuple[Field, ...], body: str) -> str:
    """A command line that asks for it, with sample ids in the place of path parameters."""
    for parameter in parameters:
        if parameter.where == "path":
            url = url.replace(f"{{{parameter.name}}}", parameter.kind.sample)
    needed = [each for each in parameters if each.where == "query" and each.is_required]
    query = "&".join(f"{each.name}={each.kind.sample}" for each in needed)
    sent = f" \\\n  -H 'Content-Type: {JSON}' \\\n  -d '{body}'" if body else ""
    how = "" if verb == "GET" else f" -X {verb}"
    return f"curl{how} '{url}{'?' if query else ''}{query}'{sent}"
