"""A reproduction as it is printed."""

from collections.abc import Iterator

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from eigenfail.cli.tables import table
from eigenfail.reproduction.results import PaperTable, Reproduction
from eigenfail.reproduction.words import heading, in_words, paper_in_words, verdict


def page(found: Reproduction) -> Group:
    """Every table, then what the paper says of them."""
    return Group(*parts(found))


def parts(found: Reproduction) -> Iterator[RenderableType]:
    """The parts of the page."""
    for each in found.tables:
        yield Text(f"\n{each.title}", style="bold")
        yield grid(each)
        if each.note:
            yield Text(each.note)
    yield Text("\nWhat the paper says", style="bold")
    for statement in found.statements:
        yield Text(f"{verdict(statement)}: {statement.paper}\n  {statement.figures}")


def grid(of: PaperTable) -> Table:
    """Our numbers, and the paper's in brackets behind them."""
    titles = [heading(column) for column in of.columns]
    drawn = table("", *titles, right=titles)
    for row in of.rows:
        numbers = zip(of.columns, row.numbers, strict=True)
        cells = (f"{in_words(c, n)}{paper_in_words(c, n)}" for c, n in numbers)
        drawn.add_row(escape(row.name), *map(escape, cells))
    return drawn
