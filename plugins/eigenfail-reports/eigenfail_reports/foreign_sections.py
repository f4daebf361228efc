"""Sections that other plug-ins add to a report.

An entry point of the group `eigenfail.report_sections` names a function of the store and the
campaigns of a report. The function returns sentences and tables, which do not depend on this
package; without content it returns nothing. The entry point's name is the name of the section:
letters in lower case, digits and dashes.
"""

import logging
import re
from collections.abc import Collection, Iterator, Sequence

import msgspec

from eigenfail import plugins
from eigenfail.presentation.tables import Block, Table, TableColumn, format_line
from eigenfail.presentation.tables import Cell as TableCell
from eigenfail.values.estimates import Rate
from eigenfail_reports.contents import Cell, ReportTable, Slug
from eigenfail_reports.material import Material
from eigenfail_reports.outcomes import list_bounds
from eigenfail_reports.page import MOST_ROWS, Grid, ReportPart, make_table

GROUP = "eigenfail.report_sections"

log = logging.getLogger(__name__)


def make_foreign_parts(material: Material, taken: Collection[str]) -> Iterator[ReportPart]:
    """Yield the sections of other plug-ins, sorted by name.

    If a section fails, its name is taken, or a file cannot have its name, the section is logged and
    left out: the report must work without it.

    Args:
        material: material of the report.
        taken: names of the sections and tables that the report has already.
    """
    campaigns = tuple(subject.campaign for subject in material.subjects)
    for name in plugins.names(GROUP):
        try:
            blocks = plugins.load(GROUP, name)(material.store, campaigns)
            part = make_part(msgspec.convert(name, Slug), blocks) if blocks else None
            if part and {name, *(table.name for table in part.tables)} & set(taken):
                raise ValueError(f"The report has a section or a table '{name}' already.")  # noqa: TRY301
        except Exception:
            log.exception("The section '%s' is left out of reports.", name)
        else:
            if part:
                yield part


def make_part(name: str, blocks: Sequence[Block]) -> ReportPart:
    """Return a section with sentences and tables.

    Args:
        name: name of the section, with dashes for spaces: its title, and the name of its tables.
        blocks: sentences and tables.

    Raises:
        TypeError: a block is neither.
    """
    if wrong := [block for block in blocks if not isinstance(block, str | Table)]:
        raise TypeError(f"{wrong[0]!r} is neither a sentence nor a Table.")
    tables = [block for block in blocks if isinstance(block, Table)]
    names = [name if place == 1 else f"{name}-{place}" for place in range(1, len(tables) + 1)]
    numbered = list(zip(names, tables, strict=True))
    # A longer table is shown as numbers, of which the page cuts what is too much.
    read = [(each, table) for each, table in numbered if 0 < len(table.rows) <= MOST_ROWS]
    return ReportPart(
        name=name,
        title=name.replace("-", " ").capitalize(),
        words=tuple(block for block in blocks if block and isinstance(block, str)),
        tables=tuple(make_report_table(each, table) for each, table in numbered),
        grids={each: (make_grid(table),) for each, table in read},
    )


def make_grid(table: Table) -> Grid:
    """Return a table as people read it."""
    rows = tuple(tuple(cell.lines for cell in row) for row in table.cells)
    return Grid(tuple(column.heading for column in table.columns), rows)


def make_report_table(name: str, table: Table) -> ReportTable:
    """Return a table as unrounded numbers; a rate has two more columns, with its bounds."""
    columns: list[tuple[str, str, str]] = []
    # By the column, not by its cells: the same file has the same columns, whatever was found.
    has_rates = [column.unit == "share" for column in table.columns]
    for column, has_rate in zip(table.columns, has_rates, strict=True):
        columns += _name_columns(column, has_rate)
    rows = [
        tuple(
            number
            for cell, has_rate in zip(row, has_rates, strict=True)
            for number in _list_numbers(cell, has_rate)
        )
        for row in table.rows
    ]
    return make_table(name, table.title, columns, rows, " ".join(table.notes))


def _name_columns(column: TableColumn, has_rates: bool) -> Iterator[tuple[str, str, str]]:
    name = re.sub("[^a-z0-9]+", "_", column.title.lower()).strip("_")
    yield (name, column.title, column.unit)
    if has_rates:
        yield (f"{name}_low", "from", column.unit)
        yield (f"{name}_high", "to", column.unit)


def _list_numbers(cell: TableCell, has_rate: bool) -> tuple[Cell, ...]:
    if isinstance(cell, Rate):
        return (cell.value, *list_bounds(cell))
    plain = cell if cell is None or isinstance(cell, str | int | float) else format_line(cell)
    return (plain, None, None) if has_rate else (plain,)
