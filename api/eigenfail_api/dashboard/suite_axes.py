"""The settings that a new suite varies: their texts in the form, their values, and their grid."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import ceil
from typing import Any

import msgspec

from eigenfail.suites import KeyPath, format_value, list_leaves
from eigenfail_api.dashboard.launch_fields import (
    NONE,
    READERS,
    LaunchField,
    format_field,
    read_number,
    read_table,
)

FEWEST_AXES = 3
"""Axes that an empty form has."""

MOST_AXES = 8
"""Axes that a form can have."""

FEWEST_STEPS, MOST_STEPS = 2, 1000
"""Bounds of the number of values from start to stop."""

LARGEST = 1e300
"""Largest magnitude of start and stop: sums and multiples of such numbers are finite."""

WHOLE_BELOW = 2**63
"""Magnitude that whole numbers of a campaign do not reach."""

DIGITS = 12
"""Significant digits of a value between start and stop: sums of floats have more."""

JSON_KINDS = frozenset({"list", "words", "table"})
"""Kinds of fields whose single values hold commas."""

PARTS = ("field", "values", "start", "stop", "number")
LEVELS = 5


class Axis(msgspec.Struct, frozen=True, kw_only=True):
    """A setting that varies, with the texts of the form.

    Attributes:
        place: its place in the form, from 1.
        field: path of the setting in a campaign.
        values: values, separated by commas, or a list in JSON.
        start: first of evenly spaced values; `stop` is the last one, and `number` how many.
    """

    place: int
    field: str = ""
    values: str = ""
    start: str = ""
    stop: str = ""
    number: str = ""

    @property
    def is_empty(self) -> bool:
        """Whether nothing is typed."""
        return not any(getattr(self, part) for part in PARTS)

    @property
    def path(self) -> KeyPath:
        """The path in a campaign, as a tuple."""
        return tuple(self.field.split("."))

    def name_part(self, part: str) -> str:
        """Return the name of one of its elements in the form."""
        return f"axis.{self.place}.{part}"


class AxisProblem(msgspec.Struct, frozen=True):
    """Why an axis has no values, and the element that it is about."""

    element: str
    words: str


def read_axes(typed: Mapping[str, str]) -> tuple[Axis, ...]:
    """Return the axes of a form, empty ones included, in its order."""
    axes = [
        Axis(place=place, **{part: typed.get(f"axis.{place}.{part}", "").strip() for part in PARTS})
        for place in range(1, MOST_AXES + 1)
    ]
    used = max((axis.place for axis in axes if not axis.is_empty), default=0)
    # One more than there are, so that there is always room for another.
    return tuple(axes[: max(FEWEST_AXES, min(used + 1, MOST_AXES))])


def make_axes(table: Mapping[str, Any]) -> tuple[Axis, ...]:
    """Return the axes of a suite's file, whose values stand in lists at the paths of settings."""
    typed: dict[str, str] = {}
    for place, (path, values) in enumerate(list_leaves(dict(table)), start=1):
        typed[f"axis.{place}.field"] = ".".join(path)
        typed[f"axis.{place}.values"] = format_values(values)
    return read_axes(typed)


def format_values(values: Any) -> str:
    """Return the values of an axis as text of the form: words with commas, or a list in JSON."""
    if not isinstance(values, list) or not all(map(_is_plain, values)):
        return msgspec.json.encode(values).decode()
    return ", ".join(map(format_field, values))


def _is_plain(value: Any) -> bool:
    if isinstance(value, str):
        return value == value.strip() != "" and "," not in value and value[0] != "["
    return value is None or isinstance(value, bool | int | float)


def find_axis_values(
    axis: Axis, field: LaunchField | None
) -> tuple[tuple[Any, ...], tuple[AxisProblem, ...]]:
    """Return the values of an axis, or why it has none.

    Args:
        axis: the axis, which is not empty.
        field: the field of the form that varies; None where the form has no such field.
    """
    problems = tuple(_list_problems(axis, field))
    if problems:
        return (), problems
    return (tuple(_read_values(axis, field)) if axis.values else tuple(_space_values(axis))), ()


def _list_problems(axis: Axis, field: LaunchField | None) -> Iterator[AxisProblem]:
    spaced = {part: getattr(axis, part) for part in ("start", "stop", "number")}
    values = axis.name_part("values")
    if not axis.field:
        yield AxisProblem(axis.name_part("field"), "Choose the setting that varies.")
    if axis.values and any(spaced.values()):
        yield AxisProblem(values, "Give values, or start, stop and number, and not both.")
    elif axis.values:
        yield from _list_value_problems(axis, field)
    elif not any(spaced.values()):
        yield AxisProblem(values, "Give values, or start, stop and number.")
    else:
        yield from _list_spacing_problems(axis, spaced)


def _list_value_problems(axis: Axis, field: LaunchField | None) -> Iterator[AxisProblem]:
    values = axis.name_part("values")
    if axis.values.startswith("["):
        read = read_table(axis.values)
        if not isinstance(read, list) or not read:
            yield AxisProblem(values, "This is not a list in JSON, such as [1, 2, 3].")
    elif field and field.kind in JSON_KINDS:
        yield AxisProblem(values, "Write these values as a list in JSON, such as [[1, 2], [3]].")
    elif not axis.values.strip(", "):
        yield AxisProblem(values, "Give at least one value.")


def _list_spacing_problems(axis: Axis, spaced: Mapping[str, str]) -> Iterator[AxisProblem]:
    for part, text in spaced.items():
        read = read_number(text)
        if not text:
            yield AxisProblem(axis.name_part(part), "Give start, stop and number.")
        elif isinstance(read, str):
            yield AxisProblem(axis.name_part(part), f"'{text[:60]}' is not a number.")
        elif part != "number" and abs(read) > LARGEST:
            words = f"Give a number from {-LARGEST:g} to {LARGEST:g}."
            yield AxisProblem(axis.name_part(part), words)
    number = read_number(axis.number) if axis.number else FEWEST_STEPS
    if isinstance(number, float) or (
        isinstance(number, int) and not FEWEST_STEPS <= number <= MOST_STEPS
    ):
        words = f"Give a whole number from {FEWEST_STEPS} to {MOST_STEPS:,}."
        yield AxisProblem(axis.name_part("number"), words)


def _read_values(axis: Axis, field: LaunchField | None) -> list[Any]:
    if axis.values.startswith("["):
        return list(read_table(axis.values))
    read = READERS[field.kind] if field else read_number
    parts = (part.strip() for part in axis.values.split(","))
    return [None if field is None and part == NONE else read(part) for part in parts if part]


def _space_values(axis: Axis) -> list[int] | list[float]:
    start, stop = (_read_end(text) for text in (axis.start, axis.stop))
    steps = int(read_number(axis.number)) - 1
    # Seeds have more digits than floats, and two whole numbers with a whole step need none.
    if isinstance(start, int) and isinstance(stop, int) and not (stop - start) % steps:
        return [start + (stop - start) // steps * step for step in range(steps + 1)]
    first, last = float(start), float(stop)
    inside = (first + (last - first) * step / steps for step in range(1, steps))
    return [first, *(float(f"{each:.{DIGITS}g}") for each in inside), last]


def _read_end(text: str) -> int | float:
    """Return start or stop: whole if it is, unless it is written with a decimal point."""
    read = read_number(text)
    if isinstance(read, int):
        return read
    number = float(read)
    is_whole = "." not in text and abs(number) < WHOLE_BELOW and number.is_integer()
    return int(number) if is_whole else number


class PreviewMember(msgspec.Struct, frozen=True, kw_only=True):
    """A member of a suite that could be launched.

    Attributes:
        name: its name in the suite.
        values: what it has on each axis, in their order; empty in a sweep.
        episodes: its budget; 0 where that is not a number.
        is_wrong: whether it would be refused.
    """

    name: str
    values: tuple[Any, ...]
    episodes: int
    is_wrong: bool


class PreviewCell(msgspec.Struct, frozen=True):
    """The members that have one pair of values.

    Attributes:
        campaigns: number of members; `episodes` is the sum of their budgets.
        level: 0 for the fewest episodes of the grid, up to `LEVELS` for the most.
        wrong: number of members that would be refused.
    """

    campaigns: int
    episodes: int
    level: int
    wrong: int


class Preview(msgspec.Struct, frozen=True, kw_only=True):
    """The members of a suite as a grid.

    Attributes:
        down: name of the setting whose values are the rows; "member" where each row is one.
        across: name of the setting whose values are the columns; empty with a single column.
        columns: values of the latter.
        rows: each value of the former, with a cell for each column.
        inside: the settings that vary within a cell.
        campaigns: number of members; `episodes` is the sum of their budgets.
    """

    down: str
    across: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[PreviewCell, ...]], ...]
    inside: tuple[str, ...]
    campaigns: int
    episodes: int

    @property
    def is_shaded(self) -> bool:
        """Whether cells differ in their number of episodes."""
        return any(cell.level for _, cells in self.rows for cell in cells)


def make_preview(names: Sequence[str], members: Sequence[PreviewMember]) -> Preview:
    """Return the grid of a suite's members.

    Args:
        names: names of the axes, in order; without any, as in a sweep, each member is a row.
        members: at least one member.
    """
    cells: dict[tuple[str, str], list[PreviewMember]] = {}
    for member in members:
        told = [*map(format_value, member.values[:2]), "", ""] if names else [member.name, ""]
        cells.setdefault((told[0], told[1]), []).append(member)
    rows, columns = (tuple(dict.fromkeys(each)) for each in zip(*cells, strict=True))
    sums = [sum(member.episodes for member in found) for found in cells.values()]
    least, most = min(sums), max(sums)
    return Preview(
        down=names[0] if names else "member",
        across=names[1] if len(names) > 1 else "",
        columns=columns,
        rows=tuple(
            (row, tuple(_make_cell(cells.get((row, each), ()), least, most) for each in columns))
            for row in rows
        ),
        inside=tuple(names[2:]),
        campaigns=len(members),
        episodes=sum(sums),
    )


def _make_cell(members: Iterable[PreviewMember], least: int, most: int) -> PreviewCell:
    found = tuple(members)
    episodes = sum(member.episodes for member in found)
    level = ceil(LEVELS * (episodes - least) / (most - least)) if found and most > least else 0
    return PreviewCell(len(found), episodes, level, sum(member.is_wrong for member in found))
