"""Columns that the tables of values have for any data, with their types.

A table of one campaign so has the types of another one's, and an empty table its columns. Columns
that come from the data, such as those of a requirement, are not among them.
"""

from collections.abc import Mapping, Sequence
from enum import Enum
from functools import cache, singledispatch
from types import MappingProxyType, NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import msgspec

from eigenfail.filters import COLUMNS, ColumnKind, find_column
from eigenfail.tabulation import name_field, records
from eigenfail.values import CampaignCost, Course, Safety
from eigenfail.values.campaign import Counts
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.records import EpisodeRow
from eigenfail.values.safety import FailurePoint
from eigenfail.values.summary import CostPoint, CourseBlock

Columns = Mapping[str, ColumnKind]
"""Types of columns by name, in the order of the table."""

NO_COLUMNS: Columns = MappingProxyType({})

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

    A sequence has those of its rows if all of them are of one type.
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


def list_named_columns(names: Sequence[str]) -> Columns:
    """Return the types of columns of episodes that are asked for by name.

    Raises:
        UnknownName: there is no such column.
    """
    return {name: find_column(name, "fields").kind for name in names}


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
    """Return the type of a column that holds these types; None where they are of several."""
    found = {
        next((column for base, column in _TYPES if issubclass(each, base)), None) for each in types
    }
    if found == {ColumnKind.WHOLE, ColumnKind.NUMBER}:
        return ColumnKind.NUMBER
    return found.pop() if len(found) == 1 else None
