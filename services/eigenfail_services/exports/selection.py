"""What is wanted of which episodes of a campaign, checked, and read a portion at a time."""

from collections.abc import Iterator
from typing import NamedTuple

import msgspec

from eigenfail.filters import (
    COLUMNS,
    Conditions,
    SortOrder,
    Value,
    parse_fields,
    parse_filter,
    parse_sort,
    read_value,
)
from eigenfail.values.export import ExportRequest
from eigenfail.values.records import PORTION, EpisodeRow
from eigenfail_services.store import Store

Cells = list[Value | None]


class Selection(msgspec.Struct, frozen=True):
    """Which episodes, in which order, and which columns of them."""

    where: Conditions
    sort: SortOrder
    columns: tuple[str, ...]


def parse_selection(request: ExportRequest) -> Selection:
    """What a request asks for.

    Raises:
        UnknownName: a column or a value that there is not.
        InvalidValue: anything else that is wrong with it.
    """
    columns = parse_fields(request.fields) or tuple(COLUMNS)
    return Selection(parse_filter(request.filter), parse_sort(request.sort), columns)


class ExportSource(NamedTuple):
    """The episodes of a campaign that are wanted."""

    store: Store
    campaign: int
    wanted: Selection


def read_batches(source: ExportSource) -> Iterator[tuple[EpisodeRow, ...]]:
    """The episodes in their order, at most `PORTION` at a time; none of these is empty."""
    store, campaign, wanted = source
    after: int | None = None
    while True:
        page = store.episodes.page(campaign, PORTION, after, wanted.where, wanted.sort)
        if page.items:
            yield page.items
        if page.next is None:
            return
        after = page.next


def read_cells(row: EpisodeRow, columns: tuple[str, ...]) -> Cells:
    """What a row has in some columns."""
    return [read_value(row, column) for column in columns]


def pick_columns(row: EpisodeRow, columns: tuple[str, ...]) -> dict[str, Value | None]:
    """The same by name."""
    return dict(zip(columns, read_cells(row, columns), strict=True))
