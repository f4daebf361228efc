"""A report as one HTML page, its tables as CSV, and the parts that both are made of."""

import csv
import io
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache
from itertools import chain, count
from math import ceil
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from eigenfail import __version__
from eigenfail.presentation.figures import UNKNOWN, format_utc
from eigenfail.presentation.svg import Drawing
from eigenfail.presentation.tables import TableColumn, format_cell
from eigenfail.values.estimates import Estimate
from eigenfail_reports.contents import (
    Cell,
    Report,
    ReportColumn,
    ReportPicture,
    ReportSection,
    ReportTable,
)
from eigenfail_reports.material import Subject, split_into_groups

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


NAMESPACES = re.compile(r' xmlns(:xlink)?="[^"]*"')


STYLE_ELEMENT = re.compile(r"\s*<defs>\s*<style.*?</style>\s*</defs>", re.DOTALL)


def inline_svg(svg: str) -> str:
    """Return the SVG as an element of an HTML page, without own namespaces and styles."""
    return NAMESPACES.sub("", STYLE_ELEMENT.sub("", svg, count=1)).replace("xlink:href", "href")


PANELS_BESIDE = 3
"""Panels of one mode, or of all, that stand beside each other; further ones stand below."""


def count_panels_beside(count: int) -> int:
    """Return the number of panels in a row."""
    return min(count, PANELS_BESIDE)


def count_panel_rows(count: int) -> int:
    """Return how many rows the panels take."""
    return ceil(count / PANELS_BESIDE)


def draw_panels(figure: "Figure", groups: int, count: int) -> "list[list[Axes]]":
    """Return the axes of a number of panels for each group; the groups begin in rows of their own.

    All panels have the same scales. Places that are left over in the last row of a group are empty.
    """
    beside, rows = count_panels_beside(count), count_panel_rows(count)
    grid = figure.subplots(groups * rows, beside, sharex=True, sharey=True, squeeze=False)
    places = grid.reshape(groups, rows * beside).tolist()
    for group in places:
        for axes in group[count:]:
            axes.set_axis_off()
    return [group[:count] for group in places]


def title_panels(groups: "Sequence[Sequence[Axes]]", below: str, beside: str) -> None:
    """Write the titles of the axes: below the lowest panels, and left of the first ones."""
    for group in groups:
        columns = count_panels_beside(len(group))
        for axes in group[::columns]:
            axes.set_ylabel(beside)
    for axes in groups[-1][-columns:]:
        axes.set_xlabel(below)
        axes.tick_params(labelbottom=True)


def draw_legend(axes: "Axes", columns: int = 1) -> None:
    """Draw the legend above the drawing, without hiding anything."""
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, borderaxespad=0.2)


BESIDE = 5
"""How many campaigns stand side by side; further ones begin a new table or picture."""


class Grid(NamedTuple):
    """A table in words; each cell is a figure, with its basis below."""

    header: tuple[str, ...]
    rows: tuple[tuple[tuple[str, ...], ...], ...]


class ReportPart(NamedTuple):
    """A section, and how people see it.

    Attributes:
        name: name of the section.
        words: sentences: findings, and how to read them.
        tables: numbers of the section.
        pictures: each picture in words, and what draws it.
        grids: tables in words, by the name of the table that they word; a table without grids is
            shown as numbers.
        folded: tables that a reader has to open first.
    """

    name: str
    title: str
    words: tuple[str, ...]
    tables: tuple[ReportTable, ...]
    pictures: tuple[tuple[ReportPicture, Drawing], ...] = ()
    grids: Mapping[str, tuple[Grid, ...]] = {}
    folded: frozenset[str] = frozenset()

    @property
    def section(self) -> ReportSection:
        """The section as data."""
        return ReportSection(
            name=self.name,
            title=self.title,
            words=self.words,
            tables=self.tables,
            pictures=tuple(picture for picture, _ in self.pictures),
        )


def make_unique(names: Sequence[str]) -> list[str]:
    """Return the names; repeated names get a number at their end."""
    made: list[str] = []
    for name in names:
        numbered = (f"{name}_{number}" for number in count(2))
        taken = {*made, *names} if name in made else ()
        made.append(next(each for each in chain((name,), numbered) if each not in taken))
    return made


def make_table(
    name: str,
    title: str,
    columns: Sequence[tuple[str, ...]],
    rows: Sequence[tuple[Cell, ...]],
    note: str = "",
) -> ReportTable:
    """Return a table of columns given as (name, title, unit) or (name, title).

    Columns may have names of channels, which users choose, so repeated names get a number at their
    end.
    """
    names = make_unique([name for name, *_ in columns])
    made = tuple(ReportColumn(name, *rest) for name, (_, *rest) in zip(names, columns, strict=True))
    return ReportTable(name=name, title=title, columns=made, rows=tuple(rows), note=note)


Item = TypeVar("Item")
ColumnOf = tuple[str, str, str, Callable[[Item], Cell]]
"""Name, title and unit of a column, and what an item has in it."""


def tabulate(
    name: str, title: str, columns: Sequence[ColumnOf[Item]], items: Iterable[Item], note: str = ""
) -> ReportTable:
    """Return a table with a row for each item."""
    rows = [tuple(find_cell(item) for *_, find_cell in columns) for item in items]
    return make_table(name, title, [column[:3] for column in columns], rows, note)


def make_comparison_grids(
    subjects: Sequence[Subject], figures: Mapping[str, Callable[[Subject], tuple[str, ...]]]
) -> tuple[Grid, ...]:
    """Return grids with a row for each figure and a column for each campaign."""
    return tuple(
        Grid(
            header=("", *(each.label for each in group)),
            rows=tuple(
                ((title,), *(figure(each) for each in group)) for title, figure in figures.items()
            ),
        )
        for group in split_into_groups(subjects, BESIDE)
    )


def make_named_grids(
    subjects: Sequence[Subject], facts: Mapping[int, Mapping[str, tuple[str, ...]]]
) -> tuple[Grid, ...]:
    """Return the same grids for given figures: by campaign id, then by name."""

    def value_of(name: str) -> Callable[[Subject], tuple[str, ...]]:
        return lambda subject: facts[subject.id].get(name, (UNKNOWN,))

    names = dict.fromkeys(name for of in facts.values() for name in of)
    return make_comparison_grids(subjects, {name: value_of(name) for name in names})


Drawn = TypeVar("Drawn")


def name_groups(items: Sequence[Drawn], name: str) -> Iterator[tuple[str, tuple[Drawn, ...]]]:
    """Yield the name of each picture, and the items that are side by side in it."""
    for number, group in enumerate(split_into_groups(items, BESIDE), start=1):
        yield (name if number == 1 else f"{name}-{number}"), tuple(group)


def list_probability(found: Estimate | None) -> tuple[float | None, ...]:
    """Return an estimate and its 95 % interval, or only a lower bound.

    Estimates and bounds have separate columns, so that readers do not take a bound for an estimate.
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
        note: parts that are left out.
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
def make_environment() -> Environment:
    """Return the environment of the template; text is escaped unless this package has drawn it."""
    made = Environment(
        loader=PackageLoader("eigenfail_reports"),
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
        report: the content.
        parts: its sections, as people see them.
        drawn: the SVG of each picture, by name.
    """
    views = tuple(make_section_view(part, drawn) for part in parts)
    return (
        make_environment().get_template("report.html").render(report=report, views=views).encode()
    )


def make_section_view(part: ReportPart, drawn: Mapping[str, str]) -> ReportView:
    """Return the view of a section."""
    tables = {table.name: table for table in part.tables}
    elsewhere = {*part.grids, *(picture.table for picture, _ in part.pictures)}
    shown: list[ShownTable] = []
    folded: list[ShownTable] = []
    for table in part.tables:
        if table.rows and table.name not in elsewhere:
            place = folded if table.name in part.folded else shown
            place.append(show_rows(table, table.rows))
    pictures = []
    for picture, _ in part.pictures:
        # Drawn by us, with every text in it escaped.
        image = Markup(inline_svg(drawn[picture.name]))  # noqa: S704
        pictures.append((picture, image, make_shown_table(picture, tables[picture.table])))
    return ReportView(
        name=part.name,
        title=part.title,
        words=part.words,
        grids=tuple((tables[name], grids) for name, grids in part.grids.items()),
        tables=tuple(shown),
        folded=tuple(folded),
        pictures=tuple(pictures),
    )


def make_shown_table(picture: ReportPicture, table: ReportTable) -> ShownTable:
    """Return the numbers behind a picture."""
    place = [column.name for column in table.columns].index("campaign")
    return show_rows(table, [row for row in table.rows if row[place] in picture.campaigns])


def show_rows(table: ReportTable, rows: Sequence[tuple[Cell, ...]]) -> ShownTable:
    """These rows of a table, or the first of them."""
    kept = rows[:MOST_ROWS]
    most = f"The first {MOST_ROWS} of {len(rows):,} rows." if len(rows) > MOST_ROWS else ""
    return ShownTable(
        name=table.name,
        title=table.title,
        header=tuple(map(title_column, table.columns)),
        figures=tuple(is_figure(place, kept) for place in range(len(table.columns))),
        rows=tuple(tuple(format_rows(table, row)) for row in kept),
        note=" ".join(filter(None, (most, table.note))),
    )


def title_column(column: ReportColumn) -> str:
    """Return the heading of a column."""
    plain = column.unit in {"", "share"}
    return column.title if plain else f"{column.title} [{column.unit}]"


def is_figure(place: int, rows: Sequence[tuple[Cell, ...]]) -> bool:
    """Return whether a column holds numbers, which are aligned to the right."""
    kinds = {type(row[place]) for row in rows}
    return kinds <= {int, float, type(None)}


def format_rows(table: ReportTable, row: tuple[Cell, ...]) -> Iterator[tuple[str, ...]]:
    """Yield the rows of a table as text."""
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
    """Return CSV in UTF-8 with a header; numbers in full precision, None as an empty field.

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
