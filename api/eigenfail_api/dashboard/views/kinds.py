"""JSON schemas in words, and small values that are in order by them."""

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

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
    told = [
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
        told.append(f"of at most {schema['maxLength']} characters")
    return ", ".join(told)


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
    """The same where nothing but a type is told."""
    inner = schema.get("properties", {})
    if inner:
        return {name: sample(inner[name], schemas) for name in schema.get("required", [])}
    if schema.get("minItems"):
        return [sample(item_of(schema), schemas)]
    return schema.get("minimum", SAMPLES[schema.get("type", "object")])
