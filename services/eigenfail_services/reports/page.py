"""A report as one HTML page, its tables as CSV, and the parts that both are made of."""

import csv
import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from typing import NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from eigenfail import __version__
from eigenfail.presentation.figures import UNKNOWN, format_utc
from eigenfail.presentation.tables import TableColumn, format_cell
from eigenfail.values import Estimate
from eigenfail.values.report import (
    Cell,
    Report,
    ReportColumn,
    ReportPicture,
    ReportSection,
    ReportTable,
)
from eigenfail_services.reports.material import Subject, in_groups
from eigenfail_services.reports.pictures import Drawing, inline

BESIDE = 5
"""How many campaigns stand side by side; further ones begin a new table or picture."""


class Grid(NamedTuple):
    """A table in words; each cell a figure, and below it what it rests on."""

    header: tuple[str, ...]
    rows: tuple[tuple[tuple[str, ...], ...], ...]


class ReportPart(NamedTuple):
    """A section, and how people see it.

    Attributes:
        grids: tables in words, by the name of the table that they word; a table without one is
            shown as it is.
        drawings: by the name of the picture.
        folded: tables that a reader has to open first.
    """

    section: ReportSection
    grids: Mapping[str, tuple[Grid, ...]] = {}
    drawings: Mapping[str, Drawing] = {}
    folded: frozenset[str] = frozenset()


def table(
    name: str,
    title: str,
    columns: Sequence[tuple[str, ...]],
    rows: Sequence[tuple[Cell, ...]],
    note: str = "",
) -> ReportTable:
    """A table of columns given as (name, title, unit), the unit left out where there is none."""
    made = tuple(ReportColumn(*column) for column in columns)
    return ReportTable(name=name, title=title, columns=made, rows=tuple(rows), note=note)


def side_by_side(
    subjects: Sequence[Subject], figures: Mapping[str, Callable[[Subject], tuple[str, ...]]]
) -> tuple[Grid, ...]:
    """A row for each figure, a column for each campaign."""
    return tuple(
        Grid(
            header=("", *(each.label for each in group)),
            rows=tuple(
                ((title,), *(figure(each) for each in group)) for title, figure in figures.items()
            ),
        )
        for group in in_groups(subjects, BESIDE)
    )


def by_name(
    subjects: Sequence[Subject], told: Mapping[int, Mapping[str, tuple[str, ...]]]
) -> tuple[Grid, ...]:
    """The same, of figures that are there: for each campaign by its id, then by name."""

    def value_of(name: str) -> Callable[[Subject], tuple[str, ...]]:
        return lambda subject: told[subject.id].get(name, (UNKNOWN,))

    names = dict.fromkeys(name for of in told.values() for name in of)
    return side_by_side(subjects, {name: value_of(name) for name in names})


def groups(subjects: Sequence[Subject], name: str) -> Iterator[tuple[str, tuple[Subject, ...]]]:
    """The campaigns that share a picture, and its name."""
    for number, group in enumerate(in_groups(subjects, BESIDE), start=1):
        yield (name if number == 1 else f"{name}-{number}"), tuple(group)


def list_probability(found: Estimate | None) -> tuple[float | None, ...]:
    """An estimate, its 95 % interval, and in their place a lower bound where it is only that.

    They stand in columns of their own, so that no reader of the table takes a bound for an
    estimate.
    """
    if found is None:
        return (None, None, None, None)
    if found.bound is not None:
        return (None, None, None, found.probability)
    if found.interval is None:
        return (found.probability, None, None, None)
    return (found.probability, found.interval.low, found.interval.high, None)


MOST_ROWS = 120
"""How many rows of a table the page has; the CSV has all."""


class ShownTable(NamedTuple):
    """A table as people see it.

    Attributes:
        figures: whether each column holds numbers.
        note: what is left out.
    """

    name: str
    title: str
    header: tuple[str, ...]
    figures: tuple[bool, ...]
    rows: tuple[tuple[tuple[str, ...], ...], ...]
    note: str


class ReportView(NamedTuple):
    """A section as people see it.

    Attributes:
        grids: tables in words.
        tables: tables of numbers.
        folded: those that a reader has to open first.
        pictures: each with its drawing and its numbers.
    """

    name: str
    title: str
    words: tuple[str, ...]
    grids: tuple[tuple[ReportTable, tuple[Grid, ...]], ...]
    tables: tuple[ShownTable, ...]
    folded: tuple[ShownTable, ...]
    pictures: tuple[tuple[ReportPicture, Markup, ShownTable], ...]


@cache
def templates() -> Environment:
    """Where the template lives; everything is escaped unless we drew it ourselves."""
    made = Environment(
        loader=PackageLoader("eigenfail_services.reports"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters["moment"] = format_utc
    made.globals["version"] = __version__
    return made


def page(report: Report, parts: Sequence[ReportPart], drawn: Mapping[str, str]) -> bytes:
    """The page.

    Args:
        report: what it tells.
        parts: its sections, as people see them.
        drawn: the SVG of each picture, by name.
    """
    views = tuple(view(part, drawn) for part in parts)
    return templates().get_template("report.html").render(report=report, views=views).encode()


def view(part: ReportPart, drawn: Mapping[str, str]) -> ReportView:
    """A section as people see it."""
    section, tables = part.section, {table.name: table for table in part.section.tables}
    elsewhere = {*part.grids, *(picture.table for picture in section.pictures)}
    plain = [each for each in section.tables if each.rows and each.name not in elsewhere]
    return ReportView(
        name=section.name,
        title=section.title,
        words=section.words,
        grids=tuple((tables[name], grids) for name, grids in part.grids.items()),
        tables=tuple(show_rows(each, each.rows) for each in plain if each.name not in part.folded),
        folded=tuple(show_rows(each, each.rows) for each in plain if each.name in part.folded),
        pictures=tuple(
            # Drawn by us, with every text in it escaped.
            (picture, Markup(inline(drawn[picture.name])), behind(picture, tables[picture.table]))  # noqa: S704
            for picture in section.pictures
        ),
    )


def behind(picture: ReportPicture, table: ReportTable) -> ShownTable:
    """The numbers that a picture shows."""
    place = [column.name for column in table.columns].index("campaign")
    return show_rows(table, [row for row in table.rows if row[place] in picture.campaigns])


def show_rows(table: ReportTable, rows: Sequence[tuple[Cell, ...]]) -> ShownTable:
    """These rows of a table, or the first of them."""
    kept = rows[:MOST_ROWS]
    most = f"The first {MOST_ROWS} of {len(rows):,} rows." if len(rows) > MOST_ROWS else ""
    return ShownTable(
        name=table.name,
        title=table.title,
        header=tuple(map(header, table.columns)),
        figures=tuple(is_figure(place, kept) for place in range(len(table.columns))),
        rows=tuple(tuple(cells(table, row)) for row in kept),
        note=" ".join(filter(None, (most, table.note))),
    )


def header(column: ReportColumn) -> str:
    """What stands above a column."""
    plain = column.unit in {"", "share"}
    return column.title if plain else f"{column.title} [{column.unit}]"


def is_figure(place: int, rows: Sequence[tuple[Cell, ...]]) -> bool:
    """Whether a column holds numbers, which stand under one another to the right."""
    kinds = {type(row[place]) for row in rows}
    return kinds <= {int, float, type(None)}


def cells(table: ReportTable, row: tuple[Cell, ...]) -> Iterator[tuple[str, ...]]:
    """A row as people read it."""
    for column, cell in zip(table.columns, row, strict=True):
        # The numbers of campaigns and episodes are names, whose digits stand together.
        is_number = isinstance(cell, (float, bool))
        text = format_cell(
            cell if is_number or cell is None else str(cell), TableColumn("", column.unit)
        )
        yield text.lines


FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""What a spreadsheet takes for the beginning of a formula, if a user's text begins with it."""


def to_csv(table: ReportTable) -> bytes:
    """UTF-8 with a header of column names; numbers as exact as they are, nothing for None.

    Text that a spreadsheet would run as a formula has an apostrophe before it.
    """
    file = io.StringIO(newline="")
    writer = csv.writer(file)
    writer.writerow([column.name for column in table.columns])
    writer.writerows([[format_plain(cell) for cell in row] for row in table.rows])
    return file.getvalue().encode()


def format_plain(cell: Cell) -> str:
    """A cell as text."""
    if cell is None:
        return ""
    if isinstance(cell, bool):
        return "true" if cell else "false"
    if isinstance(cell, str):
        return f"'{cell}" if cell.startswith(FORMULA) else cell
    return repr(cell)
