"""Fields of a form from the JSON schemas that plug-ins are listed with."""

import inspect
import re
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

from eigenfail_api.dashboard.views.launch_texts import NONE, written

Schema = Mapping[str, Any]

WORTH_TELLING = 1e15
"""Larger bounds are those of computers, not of the matter."""

IN_BRACKETS = re.compile(r"\s*\[(?P<unit>[^\]]{1,12})\]\.?\s*$")
ENTRY = re.compile(r"^ {4}(?P<name>\w+): (?P<text>.*)$")
UNITS = {
    "_usd_per_hour": "USD/h",
    "_usd": "USD",
    "_mps3": "m/s³",
    "_mps2": "m/s²",
    "_mps": "m/s",
    "_per_s2": "1/s²",
    "_per_s": "1/s",
    "_m": "m",
    "_s": "s",
}
KINDS = {
    "integer": "number",
    "number": "number",
    "string": "text",
    "boolean": "switch",
    "array": "list",
    "object": "table",
}


class Field(msgspec.Struct, frozen=True, kw_only=True):
    """A value that can be typed.

    Attributes:
        name: its path in a CampaignSpec, and in the form.
        label: the last word of that.
        kind: number, optional (a number, or off), text, choice, switch, list, table, or varied: a
            number that is fixed or drawn.
        step: of a number: 1 of whole ones.
        least: smallest value that a browser is to take; empty where there is none.
        most: largest one.
        default: what holds if nothing is typed; empty where something must be.
        bounds: what is taken, in words.
        options: of a choice.
    """

    name: str
    label: str
    kind: str
    step: str = "any"
    least: str = ""
    most: str = ""
    default: str = ""
    bounds: str = ""
    unit: str = ""
    help: str = ""
    options: tuple[str, ...] = ()
    required: bool = False

    @property
    def id(self) -> str:
        """Of its element."""
        return f"field-{self.name.replace('.', '-')}"

    @property
    def hint(self) -> str:
        """What it means, what it takes, and what it is if nothing is typed."""
        is_told = self.default not in ("", NONE) and self.kind != "choice"
        default = f"default {self.default}" if is_told else ""
        parts = (part.rstrip(".") for part in (self.help, self.bounds, default) if part)
        return " ".join(f"{part[:1].upper()}{part[1:]}." for part in parts)


class Group(msgspec.Struct, frozen=True, kw_only=True):
    """Fields that belong together, and groups of such.

    Attributes:
        name: path of what they are fields of.
        about: what it is, from its docstring.
    """

    name: str
    title: str
    about: str = ""
    fields: tuple[Field, ...] = ()
    groups: tuple["Group", ...] = ()

    def all_fields(self) -> Iterator[Field]:
        """Its own, and those of the groups in it."""
        yield from self.fields
        for group in self.groups:
            yield from group.all_fields()


def group_of(schema: Schema, name: str, title: str, varied: bool = False) -> Group:
    """The fields of an object that a schema describes.

    Args:
        schema: of it, with its `$defs`.
        name: its path.
        title: what it is called.
        varied: whether its values may be drawn from distributions.
    """
    node, defs = resolved(schema, schema), schema.get("$defs", {})
    about = inspect.cleandoc(node.get("description", ""))
    helps = dict(entries(about))
    fields, groups = list[Field](), list[Group]()
    for label, part in node.get("properties", {}).items():
        path, inner = f"{name}.{label}", {**resolved(part, schema), "$defs": defs}
        if inner.get("type") == "object" and "properties" in inner:
            groups.append(group_of(inner, path, label))
        else:
            merged = {"description": helps.get(label, ""), **part}
            required = label in node.get("required", ())
            fields.append(field_of(path, merged, schema, required, varied))
    return Group(
        name=name, title=title, about=summary(about), fields=tuple(fields), groups=tuple(groups)
    )


def field_of(
    name: str, part: Schema, schema: Schema, required: bool = False, varied: bool = False
) -> Field:
    """The field of one value."""
    plain = optional(part, schema)
    label = name.rpartition(".")[2]
    help_text, unit = without_unit(label, part.get("description", "").replace("`", ""))
    kind = "choice" if "enum" in plain else KINDS.get(plain.get("type", ""), "text")
    is_number = kind == "number"
    # A number that is off unless it is given needs no word for that; one that is on does.
    if is_number and plain is not part and part.get("default") is not None:
        kind = "optional"
    return Field(
        name=name,
        label=label,
        kind="varied" if varied and is_number else kind,
        step="1" if plain.get("type") == "integer" else "any",
        least=written(plain["minimum"]) if "minimum" in plain else "",
        most=written(plain["maximum"]) if "maximum" in plain else "",
        default=default_of(part),
        bounds=bounds(plain, kind, schema),
        unit=unit,
        help=help_text,
        options=tuple(map(str, plain.get("enum", ()))),
        required=required,
    )


def default_of(part: Schema) -> str:
    """What holds if nothing is typed."""
    value = part.get("default")
    return "" if "default" not in part or value in ([], {}) else written(value)


def resolved(part: Schema, schema: Schema) -> Schema:
    """What a reference stands for."""
    reference = part.get("$ref")
    if reference is None:
        return part
    found: Schema = schema.get("$defs", {})[reference.rpartition("/")[2]]
    return found


def optional(part: Schema, schema: Schema) -> Schema:
    """The schema of what is given where something is."""
    kinds = [each for each in part.get("anyOf", ()) if each.get("type") != "null"]
    return resolved(kinds[0] if kinds else part, schema)


def without_unit(label: str, description: str) -> tuple[str, str]:
    """The description, and the unit: in brackets at its end, or at the end of the name."""
    if match := IN_BRACKETS.search(description):
        return description[: match.start()].rstrip("."), match["unit"]
    ends = (unit for end, unit in UNITS.items() if label.endswith(end))
    return description.rstrip("."), next(ends, "")


def bounds(part: Schema, kind: str, schema: Schema) -> str:
    """What is taken, in words."""
    if kind == "list":
        inner = resolved(part.get("items", {}), schema)
        words = ", ".join(map(str, inner.get("enum", ())))
        return f"with commas in between: {words}" if words else "with commas in between"
    if kind == "table":
        return 'JSON, such as {"alpha": 100}'
    low = said(part, "at least", "minimum", "above", "exclusiveMinimum")
    high = said(part, "at most", "maximum", "below", "exclusiveMaximum")
    whole = ["whole"] if part.get("type") == "integer" else []
    off = [f"“{NONE}” switches it off"] if kind == "optional" else []
    return ", ".join([*whole, *low, *high, *off])


def said(part: Schema, closed: str, inclusive: str, opened: str, exclusive: str) -> list[str]:
    """A bound in words."""
    if abs(part.get(inclusive, 0)) > WORTH_TELLING:
        return []
    if inclusive in part:
        return [f"{closed} {number(part[inclusive])}"]
    return [f"{opened} {number(part[exclusive])}"] if exclusive in part else []


def number(value: float) -> str:
    """A bound as people write it."""
    return f"{int(value):,}" if value == int(value) else f"{value:g}"


def entries(about: str) -> Iterator[tuple[str, str]]:
    """What a docstring says of each attribute."""
    name, words = "", list[str]()
    for line in about.partition("Attributes:\n")[2].splitlines():
        if match := ENTRY.match(line):
            if name:
                yield name, " ".join(words)
            name, words = match["name"], [match["text"]]
        elif line.startswith(" " * 8):
            words.append(line.strip())
    if name:
        yield name, " ".join(words)


def summary(about: str) -> str:
    """What a docstring says before it turns to attributes."""
    return about.partition("Attributes:")[0].strip()
