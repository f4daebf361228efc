"""A report as one HTML page: no script, nothing fetched, readable on paper."""

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from eigenfail import __version__
from eigenfail.values.report import Cell, Report, ReportColumn, ReportPicture, ReportTable
from eigenfail_services.reports import formats
from eigenfail_services.reports.parts import Grid, Part
from eigenfail_services.reports.pictures import inline

MOST_ROWS = 120
"""How many rows of a table the page has; the CSV has all."""


class Shown(NamedTuple):
    """A table as people see it.

    Attributes:
        figures: whether each column holds numbers.
        note: what is left out.
    """

    name: str
    title: str
    header: tuple[str, ...]
    figures: tuple[bool, ...]
    rows: tuple[tuple[formats.Lines, ...], ...]
    note: str


class View(NamedTuple):
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
    tables: tuple[Shown, ...]
    folded: tuple[Shown, ...]
    pictures: tuple[tuple[ReportPicture, Markup, Shown], ...]


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
    made.filters["moment"] = formats.moment
    made.globals["version"] = __version__
    return made


def page(report: Report, parts: Sequence[Part], drawn: Mapping[str, str]) -> bytes:
    """The page.

    Args:
        report: what it tells.
        parts: its sections, as people see them.
        drawn: the SVG of each picture, by name.
    """
    views = tuple(view(part, drawn) for part in parts)
    return templates().get_template("report.html").render(report=report, views=views).encode()


def view(part: Part, drawn: Mapping[str, str]) -> View:
    """A section as people see it."""
    section, tables = part.section, {table.name: table for table in part.section.tables}
    elsewhere = {*part.grids, *(picture.table for picture in section.pictures)}
    plain = [each for each in section.tables if each.rows and each.name not in elsewhere]
    return View(
        name=section.name,
        title=section.title,
        words=section.words,
        grids=tuple((tables[name], grids) for name, grids in part.grids.items()),
        tables=tuple(shown(each, each.rows) for each in plain if each.name not in part.folded),
        folded=tuple(shown(each, each.rows) for each in plain if each.name in part.folded),
        pictures=tuple(
            # Drawn by us, with every text in it escaped.
            (picture, Markup(inline(drawn[picture.name])), behind(picture, tables[picture.table]))  # noqa: S704
            for picture in section.pictures
        ),
    )


def behind(picture: ReportPicture, table: ReportTable) -> Shown:
    """The numbers that a picture shows."""
    place = [column.name for column in table.columns].index("campaign")
    return shown(table, [row for row in table.rows if row[place] in picture.campaigns])


def shown(table: ReportTable, rows: Sequence[tuple[Cell, ...]]) -> Shown:
    """These rows of a table, or the first of them."""
    kept = rows[:MOST_ROWS]
    most = f"The first {MOST_ROWS} of {len(rows):,} rows." if len(rows) > MOST_ROWS else ""
    return Shown(
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


def cells(table: ReportTable, row: tuple[Cell, ...]) -> Iterator[formats.Lines]:
    """A row as people read it."""
    for column, cell in zip(table.columns, row, strict=True):
        yield (formats.cell(cell, column.unit),)
