"""Tables on a terminal; if it is too narrow, the least important columns are left out."""

from collections.abc import Iterable
from copy import copy

from rich import box
from rich.console import Console, ConsoleOptions, Group, JustifyMethod, RenderableType, RenderResult
from rich.markup import escape
from rich.table import Column
from rich.table import Table as Grid
from rich.text import Text

from eigenfail.presentation.tables import Block, FactTable, Table

LEAST_FIRST = (
    "created",
    "source",
    "worker",
    "seed",
    "digest",
    "log p of p(x)",
    "log p",
    "peak lateral",
    "peak longitudinal",
    "episodes/s",
    "severity",
    "log p/step",
    "simulator",
    "scenario",
    "planner",
    "modes",
    "USD/mode",
    "USD",
    "P(failure) [95 %]",
    "name",
    "smallest",
    "largest",
)
"""Columns in the order in which they are left out; all others go after them, the last one first."""

ALWAYS = 1
"""Number of columns that stay in any case: the subject of a row."""

READABLE = 16
"""Least width of a column of text. [characters]"""

_UNLIMITED = 1_000_000


def render(*blocks: Block) -> RenderableType:
    """Return tables and notes for a console."""
    return Group(*map(_render_block, blocks))


def _render_block(block: Block) -> RenderableType:
    if isinstance(block, Table):
        return Group(_draw_grid(block), *map(Text, block.notes))
    return _render_facts(block) if isinstance(block, FactTable) else Text(block)


def _draw_grid(table: Table) -> Grid:
    grid = FittingGrid(box=box.SIMPLE_HEAD, show_edge=False, padding=0, header_style="bold")
    for column in table.columns:
        justify: JustifyMethod = "right" if column.is_figure else "left"
        # Numbers never wrap: in two lines one number reads as two.
        grid.add_column(escape(column.label), justify=justify, no_wrap=column.is_figure)
    for row in table.cells:
        # Names may have brackets, which rich would read as markup.
        grid.add_row(*(escape(cell.line) for cell in row))
    return grid


def _render_facts(facts: FactTable) -> Grid:
    grid = Grid.grid(padding=(0, 2))
    grid.add_column(style="bold")
    grid.add_column(overflow="fold")
    for name, value in facts.rows:
        grid.add_row(escape(name), escape(value))
    return grid


class FittingGrid(Grid):
    """A table that leaves out columns one by one until it fits the screen."""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Draw the columns that fit, then name the columns that were left out."""
        kept = self._fit_columns(console, options.max_width)
        # A copy: the same table may be drawn again on a wider screen.
        shown = copy(self)
        shown.columns = kept
        yield from Grid.__rich_console__(shown, console, options)
        if missing := [str(column.header) for column in self.columns if column not in kept]:
            words = f"Too narrow for: {', '.join(missing)}. Widen the window, or use --json."
            yield Text.from_markup(words, style="dim")

    def _fit_columns(self, console: Console, width: int) -> list[Column]:
        kept = list(self.columns)
        # A pipe has no width: what programs read has all columns, and each row on one line.
        for column in self._dispensable_columns():
            if sum(_least_width(console, each) + 1 for each in kept) - 1 <= width:
                break
            kept.remove(column)
        return kept

    def _dispensable_columns(self) -> Iterable[Column]:
        rest = self.columns[ALWAYS:]
        named = [column for column in rest if str(column.header) in LEAST_FIRST]
        yield from sorted(named, key=lambda column: LEAST_FIRST.index(str(column.header)))
        yield from (column for column in reversed(rest) if column not in named)


def _least_width(console: Console, column: Column) -> int:
    """Return the least width of a column: numbers in full, texts down to their longest word."""
    # Without a limit: rich would shorten what is measured to the width of the screen.
    options = console.options.update(width=_UNLIMITED)
    cells = [console.measure(cell, options=options) for cell in (column.header, *column.cells)]
    widest = max(cell.maximum for cell in cells)
    if column.no_wrap:
        return widest
    return min(widest, max(READABLE, *(cell.minimum for cell in cells)))
