"""Values as tables for programs: rows, columns with their types, data frames and arrays.

A list, or any sequence of values, has a row for each; a course has a row for each block, and safety
for each failure. An analysis has a row for each failure, with its mode and scores. A comparison has
its two sides, a cost its curve, and noise its steps. A suite has its members, with their
differences and results. Tables for people come from `eigenfail.presentation`.

pandas and pyarrow are imported inside functions: a cell that shows a value needs neither.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from enum import Enum
from functools import cache, singledispatch
from types import MappingProxyType, NoneType, UnionType
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union, get_args, get_origin

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import InvalidValue, ServiceError
from eigenfail.filters import COLUMNS, ColumnKind, find_column, read_value
from eigenfail.values.analysis import Analysis, AnalysisResult, Mode
from eigenfail.values.campaign import Counts
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.comparison import Comparison
from eigenfail.values.disturbance import AXES, NoiseTrajectory, list_noise
from eigenfail.values.episode import EpisodeResult
from eigenfail.values.records import EpisodeDetail, EpisodeRow
from eigenfail.values.rows import Rows
from eigenfail.values.safety import FailurePoint, Safety
from eigenfail.values.suite import SuiteTable
from eigenfail.values.summary import CampaignCost, CostPoint, Course, CourseBlock
from eigenfail.wire.http import encode

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

Record = dict[str, Any]

Columns = Mapping[str, ColumnKind]
"""Types of the columns of a table by name, in the order of the table."""

NO_COLUMNS: Columns = MappingProxyType({})


@singledispatch
def records(value: object) -> Iterator[Record]:
    """The rows of a value's table.

    Raises:
        InvalidValue: the value cannot be shown as a table.
    """
    if isinstance(value, Iterable) and not isinstance(value, (str, bytes, Mapping)):
        return (flatten(row) for row in value if row is not None)
    if isinstance(value, msgspec.Struct):
        return iter([flatten(value)])
    problem = f"there is no table in a {type(value).__name__}."
    raise InvalidValue("value", problem, "Pass a list or an eigenfail object.")


@records.register
def _(value: Course) -> Iterator[Record]:
    return map(flatten, value.blocks)


@records.register
def _(value: Safety) -> Iterator[Record]:
    return map(flatten, value.scatter.points)


@records.register
def _(value: CampaignCost) -> Iterator[Record]:
    return map(flatten, value.curve)


@records.register
def _(value: Comparison) -> Iterator[Record]:
    yield {"side": "A", **flatten(value.a)}
    yield {"side": "B", **flatten(value.b)}


@records.register
def _(value: Analysis) -> Iterator[Record]:
    result = result_of(value)
    campaigns = result.campaigns or (value.campaign,) * len(result.episodes)
    for campaign, row in zip(campaigns, records(result), strict=True):
        yield {"campaign": campaign, **row}


@records.register
def _(value: AnalysisResult) -> Iterator[Record]:
    for episode, mode, scores in zip(value.episodes, value.labels, value.scores, strict=True):
        named = {f"score_{number}": float(score) for number, score in enumerate(scores, 1)}
        yield {"index": episode, "mode": mode + 1, **named}


def number_channels(count: int) -> tuple[str, ...]:
    """Return names of a number of channels whose own names are not known.

    Two channels get the names of the axes of a position.
    """
    return AXES if count == len(AXES) else tuple(f"channel_{each + 1}" for each in range(count))


@records.register
def _(value: NoiseTrajectory) -> Iterator[Record]:
    return list_noise(value, number_channels(value.z.shape[1]))


@records.register
def _(value: EpisodeResult) -> Iterator[Record]:
    return records(value.noise)


@records.register
def _(value: EpisodeDetail) -> Iterator[Record]:
    return list_noise(value.noise, value.channels)


@records.register
def _(value: SuiteTable) -> Iterator[Record]:
    for row in value.members:
        standing: Record = {"member": row.member, "state": row.state.value}
        standing["stopped_because"] = row.stopped_because
        found = flatten(row.summary)
        # A stop rule has the name of what it counts.
        named = {
            column: f"setting_{column}" if column in found else column for column in value.columns
        }
        settings = {name: row.settings.get(column) for column, name in named.items()}
        yield {**standing, **settings, **found}


def result_of(analysis: Analysis) -> AnalysisResult:
    """The findings of an analysis.

    Raises:
        InvalidValue: the analysis has not finished, or failed.
    """
    if analysis.result is None:
        why = analysis.problem or f"analysis {analysis.id} is {analysis.state}."
        raise InvalidValue("analysis", why, "Wait for it with client.analyses.wait(id).")
    return analysis.result


def flatten(row: object) -> Record:
    """Return the fields of a value, nested fields as `outer_inner`; arrays are left out.

    Episodes have the columns of filters and files, in their order. A campaign's specification and
    its counts have columns without a prefix, as lists of campaigns are sorted by.
    """
    if not isinstance(row, msgspec.Struct):
        return dict(row) if isinstance(row, Mapping) else {"value": row}
    if isinstance(row, EpisodeRow):
        return _list_episode_columns(row)
    found: Record = {}
    for name in row.__struct_fields__:
        content = getattr(row, name)
        if isinstance(content, (CampaignSpec, Counts)):
            found |= flatten(content)
        elif isinstance(content, msgspec.Struct):
            found |= {f"{name}_{inner}": each for inner, each in flatten(content).items()}
        elif not isinstance(content, np.ndarray):
            found[name_field(type(row), name)] = _unwrap(content)
    return found


def name_field(kind: type, field: str) -> str:
    """Return the name of the column of a field."""
    return _COLUMN_NAMES.get((kind, field), field)


_COLUMN_NAMES: Mapping[tuple[type, str], str] = MappingProxyType(
    {(FailurePoint, "conflict"): "class", (Mode, "number"): "mode"}
)
"""Columns whose name in filters differs from that of the field."""


def _list_episode_columns(row: EpisodeRow) -> Record:
    judged = range(1, len(row.requirements) + 1)
    names = (*COLUMNS, *(f"requirement_{number}" for number in judged))
    columns: Record = {name: _unwrap(read_value(row, name)) for name in names}
    # No filter needs these: what is pruned is no finding, and `unresolved` follows from the rest.
    return columns | {
        "unresolved": row.assessed.unresolved,
        "noise_pruned_ms": row.noise_pruned_ms,
    }


def _unwrap(content: object) -> object:
    if isinstance(content, Enum):
        return content.value
    return None if content is msgspec.UNSET else content


_TYPES = (
    (bool, ColumnKind.FLAG),
    (int, ColumnKind.WHOLE),
    (float, ColumnKind.NUMBER),
    ((str, Enum), ColumnKind.TEXT),
    ((Mapping, tuple, list), ColumnKind.TEXT),  # written as JSON
)
"""Types of columns by the types of fields; `bool` is an `int`, too."""


@singledispatch
def find_columns(value: object) -> Columns:
    """Return the columns of the table of a value that do not depend on its data.

    A sequence has the columns of its rows if all rows are of one type.
    """
    if isinstance(value, Sequence):
        kinds: set[Any] = {type(row) for row in value if row is not None}
        return list_struct_columns(kinds.pop()) if len(kinds) == 1 else NO_COLUMNS
    kind: Any = type(value)
    has_own_table = records.dispatch(kind) is not records.dispatch(object)
    return NO_COLUMNS if has_own_table else list_struct_columns(kind)


@find_columns.register
def _(_value: Course) -> Columns:
    return list_struct_columns(CourseBlock)


@find_columns.register
def _(_value: Safety) -> Columns:
    return list_struct_columns(FailurePoint)


@find_columns.register
def _(_value: CampaignCost) -> Columns:
    return list_struct_columns(CostPoint)


@cache
def list_struct_columns(kind: Any) -> Columns:
    """Return the columns of the rows that values of a type are; none of a type without fields."""
    if not (isinstance(kind, type) and issubclass(kind, msgspec.Struct)):
        return NO_COLUMNS
    if issubclass(kind, EpisodeRow):
        beside = {"unresolved": ColumnKind.FLAG, "noise_pruned_ms": ColumnKind.WHOLE}
        return {name: column.kind for name, column in COLUMNS.items()} | beside
    found: dict[str, ColumnKind] = {}
    for field in msgspec.structs.fields(kind):
        types = _list_types(field.type)
        if any(issubclass(each, msgspec.Struct) for each in types):
            # Of several kinds of values, the columns are those of the kinds that are there.
            found |= _list_inner_columns(field.name, types[0]) if len(types) == 1 else {}
        elif column := _choose_type(types):
            found[name_field(kind, field.name)] = column
    return found


def _list_inner_columns(field: str, kind: Any) -> dict[str, ColumnKind]:
    inner = list_struct_columns(kind)
    if issubclass(kind, CampaignSpec | Counts):
        return dict(inner)
    return {f"{field}_{name}": column for name, column in inner.items()}


def _list_types(hint: Any) -> tuple[type, ...]:
    """Return the types that an annotation allows, other than None and UNSET."""
    origin = get_origin(hint)
    if origin is Annotated:
        return _list_types(get_args(hint)[0])
    if origin in (Union, UnionType):
        return tuple(each for inner in get_args(hint) for each in _list_types(inner))
    if origin is Literal:
        return tuple({type(each) for each in get_args(hint)})
    plain = origin or hint
    if plain in (NoneType, msgspec.UnsetType) or not isinstance(plain, type):
        return ()
    return (plain,)


def _choose_type(types: Sequence[type]) -> ColumnKind | None:
    """Return the type of a column that holds these types; None if they are of several."""
    found = {
        next((column for base, column in _TYPES if issubclass(each, base)), None) for each in types
    }
    if found == {ColumnKind.WHOLE, ColumnKind.NUMBER}:
        return ColumnKind.NUMBER
    return found.pop() if len(found) == 1 else None


@find_columns.register(Rows)
def _(value: Rows[Any]) -> Columns:
    if isinstance(value.of, tuple):
        return {name: find_column(name, "fields").kind for name in value.of}
    return list_struct_columns(value.of)


NUMBER = (int, float)

_DTYPES = {
    ColumnKind.NUMBER: np.dtype(np.float64),
    ColumnKind.WHOLE: np.dtype(np.int64),
    ColumnKind.TEXT: np.dtype(object),
    ColumnKind.FLAG: np.dtype(np.bool_),
}
"""Types of the columns of a table without a row."""


def to_pandas(value: object) -> "pd.DataFrame":
    """The table of a value, or of a sequence of values, as a data frame.

    Raises:
        InvalidValue: the value cannot be shown as a table.
    """
    import pandas as pd

    known = find_columns(value)
    if columns := columns_of(records(value)):
        return pd.DataFrame(columns)
    return pd.DataFrame({name: pd.Series(dtype=_DTYPES[kind]) for name, kind in known.items()})


def to_arrow(value: object) -> "pa.Table":
    """The table of a value, or of a sequence of values, as an Arrow table; null if not known.

    The types of columns, other than those that come from the data, are the same for all values of
    one type, so that their tables can be concatenated.

    Raises:
        InvalidValue: the value cannot be shown as a table.
        ServiceError: pyarrow is not installed.
    """
    try:
        import pyarrow as pa
    except ImportError as error:
        raise ServiceError(
            "pyarrow is not installed.",
            "Run in a clone: pip install 'plugins/eigenfail-notebook[arrow]'; or use to_pandas().",
        ) from error
    types = {
        ColumnKind.NUMBER: pa.float64(),
        ColumnKind.WHOLE: pa.int64(),
        ColumnKind.TEXT: pa.string(),
        ColumnKind.FLAG: pa.bool_(),
    }
    known = find_columns(value)
    columns = gather_columns(records(value), known)
    chosen = {name: types[known[name]] if name in known else None for name in columns}
    return pa.table(
        {name: pa.array(simplify(column), type=chosen[name]) for name, column in columns.items()}
    )


@singledispatch
def to_numpy(value: object) -> NDArray[np.generic]:
    """The table of a value, or of a sequence of values, as a structured array.

    A number that is not known is NaN, a text that is not known is empty.

    Raises:
        InvalidValue: the value cannot be shown as a table.
    """
    columns = {name: array(column) for name, column in columns_of(records(value)).items()}
    if not columns:
        known = find_columns(value)
        return np.empty(0, dtype=[(name, _DTYPES[kind]) for name, kind in known.items()])
    length = len(next(iter(columns.values())))
    table = np.empty(length, dtype=[(name, column.dtype) for name, column in columns.items()])
    for name, column in columns.items():
        table[name] = column
    return table


@to_numpy.register
def _(value: Analysis) -> NDArray[np.generic]:
    return result_of(value).scores


@to_numpy.register
def _(value: AnalysisResult) -> NDArray[np.generic]:
    return value.scores


@to_numpy.register
def _(value: NoiseTrajectory) -> NDArray[np.generic]:
    return value.injected


@to_numpy.register
def _(value: EpisodeResult) -> NDArray[np.generic]:
    return value.noise.injected


def gather_columns(rows: Iterable[Record], known: Columns = NO_COLUMNS) -> dict[str, list[Any]]:
    """Return the columns of a table; None for a missing value.

    Args:
        rows: its rows.
        known: columns that it has in any case.
    """
    table = list(rows)
    found = dict.fromkeys(name for row in table for name in row)
    # Rows with all known columns may have others between them.
    names = found if known.keys() <= found.keys() else dict.fromkeys((*known, *found))
    columns = {name: [row.get(name) for row in table] for name in names}
    return {
        name: column
        for name, column in columns.items()
        if name in known or not _is_superfluous(name, columns, known)
    }


def _is_superfluous(name: str, columns: Mapping[str, Sequence[Any]], known: Columns) -> bool:
    """Return whether a column has nothing, and its place is taken or its type not known."""
    is_empty = bool(known) and all(each is None for each in columns[name])
    return is_empty or is_placeholder(name, columns)


def columns_of(rows: Iterable[Record]) -> dict[str, list[Any]]:
    """The columns of a table; values that a row lacks are unknown."""
    return {name: fill_column(column) for name, column in gather_columns(rows).items()}


def is_placeholder(name: str, columns: Mapping[str, Sequence[Any]]) -> bool:
    """Return whether a column is empty because the fields of its values have their own columns."""
    inner = any(other.startswith(f"{name}_") for other in columns)
    return inner and all(each is None for each in columns[name])


def fill_column(column: list[Any]) -> list[Any]:
    """Return a column with NaN for unknown numbers and empty strings for unknown texts."""
    known = [each for each in column if each is not None]
    if len(known) == len(column):
        return column
    if all(isinstance(each, str) for each in known) and known:
        return [each or "" for each in column]
    if all(isinstance(each, NUMBER) for each in known):
        return [float("nan") if each is None else each for each in column]
    return column


def simplify(column: list[Any]) -> list[Any]:
    """Return a column that every file can hold: values other than numbers and texts as JSON."""
    plain = (*NUMBER, str, type(None))
    return [each if isinstance(each, plain) else encode(each).decode() for each in column]


def array(column: list[Any]) -> NDArray[np.generic]:
    """A column as an array; of objects unless it holds only numbers or only texts."""
    if all(isinstance(each, NUMBER) for each in column) or all(
        isinstance(each, str) for each in column
    ):
        return np.array(column)
    kept = np.empty(len(column), dtype=object)
    kept[:] = column
    return kept
