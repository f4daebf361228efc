"""The form of a table, and how its cells become text.

A table holds values; `format_cell` turns them into text, and a renderer arranges the text. A cell
may have several parts: the value, its interval, the sample, and the basis of the value. A terminal
shows the parts on one line; a page and a report show them below one another.
"""

import re
from collections.abc import Callable, Iterable, Sequence
from functools import singledispatch
from itertools import chain, starmap
from typing import Any, NamedTuple

from eigenfail.presentation import figures
from eigenfail.presentation.figures import UNKNOWN
from eigenfail.presentation.rates import BASES, count_trials
from eigenfail.values.estimates import Cost, Estimate, Rate
from eigenfail.values.safety import Figure
from eigenfail.values.summary import MeanTime

NO_FAILURE = "no failure"
OF_SEARCH = "of its search"
"""Behind the share of a search where a column also has failure rates under p(x)."""

_SENTENCE_CASE = re.compile(r"[A-Z][a-z]+\b")


class FormattedCell(NamedTuple):
    """A cell as text.

    Attributes:
        value: the value, with its unit if the column does not show it.
        interval: 95 % interval, in brackets; empty without one.
        sample: number of episodes behind the value, if it is not in another column.
        basis: further facts behind the value, one per line; terminals leave them out.
    """

    value: str
    interval: str = ""
    sample: str = ""
    basis: tuple[str, ...] = ()

    @property
    def line(self) -> str:
        """Value, interval and sample on one line."""
        sample = f"({self.sample})" if self.sample else ""
        return " ".join(filter(None, (self.value, self.interval, sample)))

    @property
    def notes(self) -> tuple[str, ...]:
        """The lines below the value."""
        interval = f"95 %: {self.interval}" if self.interval else ""
        return tuple(filter(None, (interval, self.sample, *self.basis)))

    @property
    def lines(self) -> tuple[str, ...]:
        """The value, and the lines below it."""
        return (self.value, *self.notes)


Cell = FormattedCell | Rate | Cost | Estimate | Figure | MeanTime | str | int | float | None


class TableColumn(NamedTuple):
    """A column of a table.

    Attributes:
        title: title, in sentence case.
        unit: unit of its numbers; "share" for shares of one, which are shown in percent.
        is_figure: whether it holds numbers, which are aligned to the right.
        digits: significant digits of its numbers.
    """

    title: str
    unit: str = ""
    is_figure: bool = True
    digits: int = figures.DIGITS

    @property
    def label(self) -> str:
        """The title in lower case, unless it begins with a symbol or a name."""
        title = self.title
        return title[:1].lower() + title[1:] if _SENTENCE_CASE.match(title) else title

    @property
    def heading(self) -> str:
        """The title with the unit."""
        return self.title if self.unit in {"", "share"} else f"{self.title} [{self.unit}]"


PLAIN = TableColumn("")
SHARE = TableColumn("", "share")


class Table(NamedTuple):
    """A table of values.

    Attributes:
        notes: sentences below the table on how to read it.
    """

    title: str
    columns: tuple[TableColumn, ...]
    rows: tuple[tuple[Cell, ...], ...]
    notes: tuple[str, ...] = ()

    @property
    def cells(self) -> tuple[tuple[FormattedCell, ...], ...]:
        """The rows as text."""
        return tuple(
            tuple(starmap(format_cell, zip(row, self.columns, strict=True))) for row in self.rows
        )


class FactTable(NamedTuple):
    """Names and values, one pair a line."""

    title: str
    rows: tuple[tuple[str, str], ...]


Block = Table | FactTable | str
"""A part of a view: a table, or a text as a paragraph; an empty text is a gap."""


class Reading(NamedTuple):
    """A column, and the field name or function that reads its value from a row."""

    column: TableColumn
    read: str | Callable[[Any], Cell]


def tabulate(
    title: str, rows: Iterable[object], *readings: Reading, notes: tuple[str, ...] = ()
) -> Table:
    """Return a table with a row for each value; a field of a field is named with a dot."""
    cells = tuple(tuple(_read_cell(row, each.read) for each in readings) for row in rows)
    return Table(title, tuple(each.column for each in readings), cells, notes)


def _read_cell(row: Any, read: str | Callable[[Any], Cell]) -> Any:
    if not isinstance(read, str):
        return read(row)
    for name in read.split("."):
        # A field of what is missing is missing, too: its cell is a dash.
        row = None if row is None else getattr(row, name)
    return row


def read_text(title: str, read: str | Callable[[Any], Cell]) -> Reading:
    """Return a column of text."""
    return Reading(TableColumn(title, is_figure=False), read)


def read_number(title: str, read: str | Callable[[Any], Cell], unit: str = "") -> Reading:
    """Return a column of numbers."""
    return Reading(TableColumn(title, unit), read)


def read_utc(title: str, field: str) -> Reading:
    """Return a column of times in UTC, from milliseconds since 1970."""
    return read_text(title, lambda row: figures.format_utc(_read_cell(row, field)))


def name_columns(*titles: str) -> tuple[TableColumn, ...]:
    """Return columns of text with the given titles."""
    return tuple(TableColumn(title, is_figure=False) for title in titles)


def count_columns(*titles: str) -> tuple[TableColumn, ...]:
    """Return columns of numbers with the given titles."""
    return tuple(map(TableColumn, titles))


def transpose(table: Table, heading: str = "") -> Table:
    """Return the table with a row for each of its columns; its first column heads the others."""
    # Formatted first: the columns of the result mix the units of all rows.
    heads, *others = zip(*table.cells, strict=True) if table.rows else ((),)
    columns = (heading, *(cell.value for cell in heads))
    titles = (column.heading for column in table.columns[1:])
    rows = tuple((title, *cells) for title, cells in zip(titles, others, strict=True))
    return Table(table.title, name_columns(*columns), rows, table.notes)


def list_notes(blocks: Iterable[Sequence[str]]) -> tuple[str, ...]:
    """Return the distinct sentences that are not empty."""
    return tuple(dict.fromkeys(filter(None, chain.from_iterable(blocks))))


def format_cell(value: Cell, column: TableColumn = PLAIN) -> FormattedCell:
    """Return a value in a column as a formatted cell."""
    # Only floats need their column, for its unit and digits.
    if isinstance(value, float):
        return FormattedCell(_format_float(value, column))
    return _format(value)


def format_line(value: Cell, column: TableColumn = PLAIN) -> str:
    """Return a value as text on one line."""
    return format_cell(value, column).line


def format_cost(value: Cost) -> FormattedCell:
    """Return the cost per failure with its unit."""
    cell = format_cell(value)
    interval = f"{cell.interval} USD" if cell.interval else ""
    return cell._replace(value=figures.put_unit(cell.value, "USD"), interval=interval)


def _format_float(value: float, column: TableColumn) -> str:
    if column.unit == "share":
        return figures.format_share(value, column.digits)
    if column.unit == "USD":
        return figures.format_usd(value)
    return figures.format_number(value, column.digits)


@singledispatch
def _format(value: Cell) -> FormattedCell:
    return FormattedCell(UNKNOWN if value is None else str(value))


@_format.register
def _(value: FormattedCell) -> FormattedCell:
    return value


# Registered by itself, since bool is a kind of int: True would be the count 1.
@_format.register
def _(value: bool) -> FormattedCell:
    return FormattedCell("yes" if value else "no")


@_format.register
def _(value: int) -> FormattedCell:
    return FormattedCell(figures.format_count(value))


@_format.register
def _(value: Rate) -> FormattedCell:
    """Return a share with its interval; without an event, the upper bound, near 3 / n."""
    if value.interval is None:
        return FormattedCell(f"{figures.format_share(value.value)} {OF_SEARCH}")
    # The interval of a rate of 0 begins at 0: only its upper end says something.
    if not value.k:
        bound = figures.format_upper_bound(value.interval.high)
        basis = ("95 % upper bound", *BASES[value.design])
        return FormattedCell(bound, sample=count_trials(value), basis=basis)
    interval = figures.format_interval(value.interval, 100.0)
    return FormattedCell(figures.format_share(value.value), interval, basis=BASES[value.design])


@_format.register
def _(value: Cost) -> FormattedCell:
    """Return the cost per failure in USD, with its interval or lower end; else a lower bound."""
    if value.per_failure_usd is None:
        if value.at_least_usd is None:
            return FormattedCell(UNKNOWN, basis=(NO_FAILURE,))
        # Rounded down, so that what is printed stays a lower bound.
        bound = f"≥ {figures.format_usd(figures.round_down(value.at_least_usd))}"
        return FormattedCell(bound, basis=("95 % lower bound",))
    amount = figures.format_usd(value.per_failure_usd)
    if value.interval_usd is None:
        known = value.at_least_usd is not None
        open_above = f"[{figures.format_usd(value.at_least_usd)}, ∞)" if known else ""
        return FormattedCell(amount, open_above)
    return FormattedCell(amount, figures.format_usd_interval(value.interval_usd))


@_format.register
def _(value: Estimate) -> FormattedCell:
    """Return the failure probability, with its interval or as a bound, or why it is unknown."""
    sample, notes = f"n = {value.episodes:,}", tuple(filter(None, (value.note,)))
    if value.probability is not None and value.bound is not None:
        bound = f"at least {figures.format_number(figures.round_down(value.probability))}"
        basis = ("lower bound without a confidence level", f"by {value.by}", *notes)
        return FormattedCell(bound, "", sample, basis)
    if value.probability is None or value.interval is None:
        return FormattedCell(UNKNOWN, basis=(f"by {value.by}", value.problem))
    basis = (f"by {value.by}, cv {figures.format_number(value.cv)}", *notes)
    interval = figures.format_interval(value.interval)
    return FormattedCell(figures.format_number(value.probability), interval, sample, basis)


@_format.register
def _(value: Figure) -> FormattedCell:
    interval = figures.format_interval(value.interval) if value.interval else ""
    return FormattedCell(figures.format_number(value.value), interval)


@_format.register
def _(value: MeanTime) -> FormattedCell:
    """Return a mean time with its number of episodes."""
    if value.mean_s is None:
        return FormattedCell(UNKNOWN)
    return FormattedCell(f"{figures.format_number(value.mean_s)} s", sample=f"n = {value.n:,}")
