"""Values as notebooks show them: the tables and sentences of the command line, as HTML.

Everything is escaped; there is no script and no style, so that the notebook's own holds.
"""

from collections.abc import Callable, Iterator
from functools import singledispatch
from html import escape
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from eigenfail.cli.campaign_facts import campaign_facts
from eigenfail.cli.compare import comparison_page
from eigenfail.cli.costs import parts as cost_parts
from eigenfail.cli.course_tables import course_table
from eigenfail.cli.episode_tables import episode_table
from eigenfail.cli.mode_tables import component_words, distinctness_words, mode_table
from eigenfail.cli.proofs import proof_table, proof_words
from eigenfail.cli.safety import parts as safety_parts
from eigenfail.cli.suite_lists import named_suite, suite_list
from eigenfail.cli.tables import campaign_table, facts, result_table, table
from eigenfail.rows import SHOWN, Rows
from eigenfail.tabulation import flat
from eigenfail.values import (
    Analysis,
    Campaign,
    CampaignCost,
    Comparison,
    Course,
    Proof,
    Safety,
    Summary,
)
from eigenfail.values.records import EpisodeRow
from eigenfail.values.suite import SuiteStanding, SuiteTable

Drawing = RenderableType

LISTS: dict[type, Callable[[Any], Drawing]] = {
    Campaign: campaign_table,
    Summary: result_table,
    EpisodeRow: episode_table,
    SuiteStanding: suite_list,
}
"""How rows of a kind are put into one table; those of others show all of their fields."""


def html(value: object) -> str:
    """A value as HTML."""
    return "".join(written(drawn(value)))


@singledispatch
def drawn(value: object) -> Drawing:
    """A value as the command line draws it; others override this for their own kinds."""
    return Text(repr(value))


@drawn.register
def _(value: Campaign) -> Drawing:
    return campaign_facts(value)


@drawn.register
def _(value: Summary) -> Drawing:
    return result_table([value])


@drawn.register
def _(value: Course) -> Drawing:
    return course_table(value)


@drawn.register
def _(value: Safety) -> Drawing:
    return Group(*safety_parts(value))


@drawn.register
def _(value: Comparison) -> Drawing:
    return comparison_page(value)


@drawn.register
def _(value: SuiteTable) -> Drawing:
    return named_suite(value)


@drawn.register
def _(value: CampaignCost) -> Drawing:
    return Group(*cost_parts([value]))


@drawn.register
def _(value: Proof) -> Drawing:
    return Group(proof_table(value), *map(Text, proof_words(value)))


@drawn.register
def _(value: Analysis) -> Drawing:
    heading = facts([(f"analysis {value.id}", f"of campaign {value.campaign}: {value.state}")])
    if value.result is None:
        return Group(heading, Text(value.problem))
    words = (component_words(value.result), distinctness_words(value.result), *value.result.words)
    return Group(heading, mode_table(value.campaign, value.result), *map(Text, words))


@drawn.register
def _(value: Rows) -> Drawing:  # type: ignore[type-arg]  # singledispatch takes plain classes
    seen = value.first(SHOWN + 1)
    if not seen:
        return Text("Nothing.")
    draw = LISTS.get(type(seen[0]), plain_table)
    more = [Text(f"The first {SHOWN}; there are more.")] if len(seen) > SHOWN else []
    return Group(draw(seen[:SHOWN]), *more)


def plain_table(rows: tuple[object, ...]) -> Table:
    """Values of any kind, one a row."""
    records = [flat(row) for row in rows]
    names = tuple(dict.fromkeys(name for record in records for name in record))
    grid = table(*names)
    for record in records:
        grid.add_row(*(Text(str(record.get(name, ""))) for name in names))
    return grid


def written(drawing: object) -> Iterator[str]:
    """What is drawn, as HTML."""
    if isinstance(drawing, Group):
        for part in drawing.renderables:
            yield from written(part)
    elif isinstance(drawing, Table):
        yield from written_table(drawing)
    elif said := plain(drawing):
        yield f"<p>{escape(said)}</p>"


def written_table(grid: Table) -> Iterator[str]:
    """A table with its headings; without, its first column has the headings of the rows."""
    cells = [[plain(cell) for cell in column.cells] for column in grid.columns]
    yield "<table>"
    if grid.show_header:
        names = (f"<th>{escape(plain(column.header))}</th>" for column in grid.columns)
        yield f"<thead><tr>{''.join(names)}</tr></thead>"
    yield "<tbody>"
    for first, *others in zip(*cells, strict=True):
        tag = "td" if grid.show_header else "th"
        rest = "".join(f"<td>{escape(cell)}</td>" for cell in others)
        yield f"<tr><{tag}>{escape(first)}</{tag}>{rest}</tr>"
    yield "</tbody></table>"


def plain(cell: object) -> str:
    """The text of a cell or a sentence, without marks for terminals."""
    return cell.plain if isinstance(cell, Text) else Text.from_markup(str(cell)).plain
