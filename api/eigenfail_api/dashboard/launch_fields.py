"""The fields of the launch form: labels, types, bounds, and order."""

import inspect
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import msgspec

from eigenfail.suites import read_path, set_path
from eigenfail_api.openapi import parse_attributes

NONE = "none"
"""Value that switches off an option which is on by default."""

WHOLE = re.compile(r"[+-]?[0-9]{1,19}")
NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,4})?")


def read_number(text: str) -> int | float | str:
    """Return a typed number; return the text if it is not a number, for the check to refuse."""
    # Python would also read 1_000 and other digits than 0 to 9, which JSON does not have.
    if WHOLE.fullmatch(text):
        return int(text)
    return float(text) if NUMBER.fullmatch(text) else text


def parse_text(kind: str, text: str) -> Any:
    """Return the value of a text for a kind of field.

    A text that cannot be read stays a text. The check of the spec then names the field and the
    error.
    """
    if kind in ("list", "words"):
        parts = [part.strip() for part in text.split(",") if part.strip()]
        # Digits stay text among words: a tag may be a number.
        return parts if kind == "words" else list(map(read_number, parts))
    if kind in ("number", "varied", "optional"):
        return None if kind == "optional" and text == NONE else read_number(text)
    if kind == "table":
        try:
            return msgspec.json.decode(text)
        except (msgspec.DecodeError, RecursionError):
            return text
    return {"true": True, "false": False}.get(text, text) if kind == "switch" else text


def format_field(value: Any) -> str:
    """Return a value as the text of a field."""
    if value is None:
        return NONE
    if isinstance(value, str):
        return value
    if isinstance(value, list | tuple) and not any(isinstance(part, dict) for part in value):
        return ", ".join(map(format_field, value))
    return msgspec.json.encode(value).decode()


Schema = Mapping[str, Any]

WORTH_TELLING = 1e15
"""Larger bounds are those of computers, not of the matter."""

IN_BRACKETS = re.compile(r"\s*\[(?P<unit>[^\]]{1,12})\]\.?\s*$")
LIMITS = {
    "minimum": "at least",
    "exclusiveMinimum": "above",
    "maximum": "at most",
    "exclusiveMaximum": "below",
}
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


class LaunchField(msgspec.Struct, frozen=True, kw_only=True):
    """A value that can be typed.

    Attributes:
        name: its path in a CampaignSpec, and in the form.
        label: the last word of the path.
        kind: number, optional (a number, or off), text, choice, switch, list, words, table, or
            varied: a number that is fixed or drawn.
        step: step of a number: 1 for whole numbers.
        least: smallest value that a browser is to take; empty if there is none.
        most: largest value, likewise.
        default: value if nothing is typed; empty if something must be typed.
        bounds: describes the valid values.
        options: options of a choice.
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
        """Return the id of the field's element."""
        return f"field-{self.name.replace('.', '-')}"

    @property
    def hint(self) -> str:
        """Return the help, the accepted values and the default of the field."""
        is_told = self.default not in ("", NONE) and self.kind != "choice"
        default = f"default {self.default}" if is_told else ""
        parts = (part.rstrip(".") for part in (self.help, self.bounds, default) if part)
        return " ".join(f"{part[:1].upper()}{part[1:]}." for part in parts)


class LaunchGroup(msgspec.Struct, frozen=True, kw_only=True):
    """Fields that belong together, and nested groups.

    Attributes:
        name: path of the object that has the fields.
        about: description of the object, from its docstring.
    """

    name: str
    title: str
    about: str = ""
    fields: tuple[LaunchField, ...] = ()
    groups: tuple["LaunchGroup", ...] = ()

    def all_fields(self) -> Iterator[LaunchField]:
        """Yield the fields of the group and of the groups in it."""
        yield from self.fields
        for group in self.groups:
            yield from group.all_fields()


def group_of(schema: Schema, name: str, title: str, varied: bool = False) -> LaunchGroup:
    """Return the form fields of an object that a schema describes.

    Args:
        schema: JSON schema of the setting, with its `$defs`.
        name: path of the setting.
        title: title of the group.
        varied: whether the setting's values may be drawn from distributions.
    """
    # References count from the top of the schema: nested groups need the same definitions.
    node, defs = resolve_schema(schema, schema), schema.get("$defs", {})
    about, _, attributes = inspect.cleandoc(node.get("description", "")).partition("Attributes:\n")
    helps = dict(parse_attributes(attributes))
    fields, groups = list[LaunchField](), list[LaunchGroup]()
    for label, part in node.get("properties", {}).items():
        path, inner = f"{name}.{label}", {**resolve_schema(part, schema), "$defs": defs}
        if inner.get("type") == "object" and "properties" in inner:
            groups.append(group_of(inner, path, label))
        else:
            merged = {"description": helps.get(label, ""), **part}
            required = label in node.get("required", ())
            fields.append(make_field(path, merged, schema, required, varied))
    return LaunchGroup(
        name=name,
        title=title,
        about=about.strip(),
        fields=tuple(fields),
        groups=tuple(groups),
    )


def make_field(
    name: str, part: Schema, schema: Schema, required: bool = False, varied: bool = False
) -> LaunchField:
    """Return the form field of a value."""
    plain = unwrap_optional(part, schema)
    label = name.rpartition(".")[2]
    help_text, unit = split_unit(label, part.get("description", "").replace("`", ""))
    kind = "choice" if "enum" in plain else KINDS.get(plain.get("type", ""), "text")
    if kind == "list" and describe_items(plain, schema).get("type") == "object":
        kind = "table"
    if kind == "list" and describe_items(plain, schema).get("type") == "string":
        kind = "words"
    is_number = kind == "number"
    # A number that is off unless it is given needs no word for that; one that is on does.
    if is_number and plain is not part and part.get("default") is not None:
        kind = "optional"
    return LaunchField(
        name=name,
        label=label,
        kind="varied" if varied and is_number else kind,
        step="1" if plain.get("type") == "integer" else "any",
        least=format_field(plain["minimum"]) if "minimum" in plain else "",
        most=format_field(plain["maximum"]) if "maximum" in plain else "",
        # Empty lists and tables look like nothing in a form.
        default="" if part.get("default", {}) in ([], {}) else format_field(part["default"]),
        bounds="" if "JSON" in help_text else describe_bounds(plain, kind, schema),
        unit=unit,
        help=help_text,
        options=tuple(map(str, plain.get("enum", ()))),
        required=required,
    )


def describe_items(part: Schema, schema: Schema) -> Schema:
    """Return the schema of the items of a list."""
    return unwrap_optional(part.get("items", {}), schema)


def resolve_schema(part: Schema, schema: Schema) -> Schema:
    """Return the schema that a reference names."""
    reference = part.get("$ref")
    if reference is None:
        return part
    found: Schema = schema.get("$defs", {})[reference.rpartition("/")[2]]
    return found


def unwrap_optional(part: Schema, schema: Schema) -> Schema:
    """Return the schema of an optional field's value, without null."""
    kinds = [each for each in part.get("anyOf", ()) if each.get("type") != "null"]
    return resolve_schema(kinds[0] if kinds else part, schema)


def split_unit(label: str, description: str) -> tuple[str, str]:
    """Return the description and the unit, from its brackets or from the end of the name."""
    if match := IN_BRACKETS.search(description):
        return description[: match.start()].rstrip("."), match["unit"]
    ends = (unit for end, unit in UNITS.items() if label.endswith(end))
    return description.rstrip("."), next(ends, "")


def describe_bounds(part: Schema, kind: str, schema: Schema) -> str:
    """Return the accepted values of a field as text."""
    if kind in ("list", "words"):
        inner = resolve_schema(part.get("items", {}), schema)
        words = ", ".join(map(str, inner.get("enum", ())))
        return f"separated by commas: {words}" if words else "separated by commas"
    if kind == "table":
        is_list = part.get("type") == "array"
        return 'JSON, such as [{"name": "speed"}]' if is_list else 'JSON, such as {"alpha": 100}'
    limits = [
        f"{words} {format_bound(part[name])}"
        for name, words in LIMITS.items()
        # Bounds of 64 bits are no advice to a person.
        if name in part and abs(part[name]) <= WORTH_TELLING
    ]
    whole = ["whole"] if part.get("type") == "integer" else []
    off = [f"“{NONE}” disables it"] if kind == "optional" else []
    return ", ".join([*whole, *limits, *off])


def format_bound(value: float) -> str:
    """Return a bound as text."""
    return f"{int(value):,}" if value == int(value) else f"{value:g}"


HOW, LOW, HIGH, CHOICES = ".how", ".low", ".high", ".choices"


FIXED, UNIFORM, CHOICE = "fixed", "uniform", "choice"


class LaunchEntry(msgspec.Struct, frozen=True, kw_only=True):
    """The content of a field.

    Attributes:
        text: as it was typed.
        how: fixed, or the distribution that the value is drawn from.
        low: smallest value of a uniform distribution; high: its largest.
        choices: the values of a choice, comma-separated.
    """

    text: str = ""
    how: str = FIXED
    low: str = ""
    high: str = ""
    choices: str = ""


class Texts(msgspec.Struct, frozen=True):
    """The texts typed into the form, and the fields of the campaign that it was opened with.

    Attributes:
        typed: by the name of the form's element.
        base: fields of a CampaignSpec; empty if the form began empty.
    """

    typed: Mapping[str, str]
    base: Mapping[str, Any]

    def entry(self, field: LaunchField) -> LaunchEntry:
        """Return the text of a field: the typed one, or the initial one."""
        name = field.name
        # A form that was sent has all of its fields, also empty ones: only the first page lacks
        # them.
        if name not in self.typed and name + HOW not in self.typed:
            return self._began_with(field)
        get = self.typed.get
        return LaunchEntry(
            text=get(name, "").strip(),
            how=get(name + HOW, FIXED),
            low=get(name + LOW, "").strip(),
            high=get(name + HIGH, "").strip(),
            choices=get(name + CHOICES, "").strip(),
        )

    def _began_with(self, field: LaunchField) -> LaunchEntry:
        *above, label = field.name.split(".")
        table = read_path(dict(self.base), tuple(above)) if above else self.base
        if not isinstance(table, Mapping) or label not in table:
            return LaunchEntry()
        match table[label]:
            # An option that is off by default needs no entry; one that is on by default does.
            case None if field.kind != "optional":
                return LaunchEntry()
            case {"uniform": [low, high]}:
                return LaunchEntry(how=UNIFORM, low=format_field(low), high=format_field(high))
            case {"choice": [*values]}:
                return LaunchEntry(how=CHOICE, choices=format_field(values))
            case value:
                return LaunchEntry(text=format_field(value))


def make_body(fields: Iterable[LaunchField], texts: Texts) -> dict[str, Any]:
    """Return the fields of a campaign as the body of a launch request, without empty ones."""
    body: dict[str, Any] = {}
    for field in fields:
        given = parse_value(field, texts.entry(field))
        if given:
            body = set_path(body, tuple(field.name.split(".")), given[0])
    return body


def parse_value(field: LaunchField, entry: LaunchEntry) -> tuple[Any, ...]:
    """Return the value of a field as a tuple of one; an empty tuple if nothing is entered."""
    if entry.how == UNIFORM:
        return ({"uniform": [read_number(entry.low), read_number(entry.high)]},)
    if entry.how == CHOICE:
        return ({"choice": parse_text("list", entry.choices)},)
    if not entry.text:
        return ()
    return (parse_text(field.kind, entry.text),)


def format_entry(entry: LaunchEntry) -> str:
    """Return the content of a field as text, for comparison with its first content."""
    if entry.how == UNIFORM:
        return f"uniform {entry.low} … {entry.high}"
    return f"one of {entry.choices}" if entry.how == CHOICE else entry.text
