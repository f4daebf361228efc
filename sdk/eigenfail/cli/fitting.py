"""Tables that fit the screen: where it is too narrow, what matters least is left out, and said."""

from collections.abc import Iterable
from copy import copy

from rich.console import Console, ConsoleOptions, RenderResult
from rich.table import Column, Table
from rich.text import Text

LEAST_FIRST = (
    *("created", "source", "worker", "seed", "digest", "of p(x)", "log p"),
    *("peak lateral", "peak longitudinal", "episodes/s", "severity", "log p/step"),
    *("simulator", "scenario", "planner", "modes", "USD/mode", "USD"),
    *("P(failure) [95 %]", "name"),
)
"""Columns by how soon they may go; those that are not named go after them, the last one first."""

ALWAYS = 1
"""How many columns stay in any case: what a row is about."""

READABLE = 16
"""Below this width a text is not worth showing. [characters]"""

UNLIMITED = 1_000_000


class Fitting(Table):
    """A table whose columns go one by one until the rest fit."""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Draw what fits, then say what does not."""
        kept = self.fitted(console, options.max_width)
        shown = copy(self)
        shown.columns = kept
        yield from Table.__rich_console__(shown, console, options)
        if missing := [str(column.header) for column in self.columns if column not in kept]:
            words = f"Too narrow for: {', '.join(missing)}. Widen the window, or take --json."
            yield Text.from_markup(words, style="dim")

    def fitted(self, console: Console, width: int) -> list[Column]:
        """The columns that fit, in order."""
        kept = list(self.columns)
        for column in self.dispensable():
            if self.needed(console, kept) <= width:
                break
            kept.remove(column)
        return kept

    def dispensable(self) -> Iterable[Column]:
        """The columns that may go, in the order in which they do."""
        rest = self.columns[ALWAYS:]
        named = [column for column in rest if str(column.header) in LEAST_FIRST]
        yield from sorted(named, key=lambda column: LEAST_FIRST.index(str(column.header)))
        yield from (column for column in reversed(rest) if column not in named)

    def needed(self, console: Console, columns: Iterable[Column]) -> int:
        """How wide these columns are at least: figures in full, texts as far as words allow."""
        return sum(self.narrowest(console, column) + 1 for column in columns) - 1

    def narrowest(self, console: Console, column: Column) -> int:
        """The width below which a column cannot be read."""
        options = console.options.update(width=UNLIMITED)
        cells = [console.measure(cell, options=options) for cell in (column.header, *column.cells)]
        widest = max(cell.maximum for cell in cells)
        if column.no_wrap:
            return widest
        return min(widest, max(READABLE, *(cell.minimum for cell in cells)))
