"""The paper's tables and statements beside ours, in Markdown."""

from collections.abc import Iterator, Sequence

from eigenfail.reproduction.claims import claim_name
from eigenfail.reproduction.results import Column, Number, PaperTable, Reproduction, Row
from eigenfail.reproduction.words import UNKNOWN, figure, heading, verdict

OPENING = """# The paper's experiments, reproduced

`eigenfail reproduce --scale {scale}` runs what the paper ran on this world: our planner
`rulebook`, our scenario `cut_in`, our simulator. The paper's planner and simulator are not public,
and its episodes have eight times as many steps: the pattern is to be expected here, not the same
numbers. `ast_paper` and `difs_paper` have the paper's settings, `ast` and `difs` our defaults.
In brackets are 95 % intervals; the paper gives none. Every campaign has the seed {seed}; those that
evaluate draw from one that is 1000 higher.
"""


def page(found: Reproduction) -> str:
    """The page in Markdown."""
    opening = OPENING.format(scale=found.scale, seed=found.seed)
    return "\n".join((opening, *tables(found), *statements(found)))


def tables(found: Reproduction) -> Iterator[str]:
    """A section for each table."""
    for table in found.tables:
        yield f"## {table.title}\n"
        yield from grid(table)
        yield f"\n{table.note}\n" if table.note else ""


def grid(table: PaperTable) -> Iterator[str]:
    """Our numbers, and behind those of which the paper prints some the paper's."""
    columns = [*zip(*(row.numbers for row in table.rows), strict=True)]
    beside = [any(number.paper is not None for number in column) for column in columns]
    yield f"| |{''.join(headings(table, beside))}"
    yield f"|---|{'--:|' * (len(beside) + sum(beside))}"
    for row in table.rows:
        yield f"| {row.name} |{''.join(cells(table, row, beside))}"


def headings(table: PaperTable, beside: Sequence[bool]) -> Iterator[str]:
    """What stands over the columns."""
    for column, has in zip(table.columns, beside, strict=False):
        yield f" {heading(column)} |{has * ' paper |'}"


def cells(table: PaperTable, row: Row, beside: Sequence[bool]) -> Iterator[str]:
    """Our numbers, each marked as the claim that it is, and the paper's."""
    for column, number, has in zip(table.columns, row.numbers, beside, strict=True):
        paper = UNKNOWN if number.paper is None else figure(column, number.paper)
        yield f" {marked(table, row, column, number)} |{has * f' {paper} |'}"


def marked(table: PaperTable, row: Row, column: Column, number: Number) -> str:
    """Our number with its interval and its mark."""
    if number.value is None:
        return UNKNOWN
    unit = " %" if column.unit == "share" else ""
    ends = number.interval and (number.interval.low, number.interval.high)
    interval = f" [{', '.join(figure(column, end) for end in ends)}]" if ends else ""
    name = claim_name(table, row, column)
    return f"{figure(column, number.value)}{unit}{interval}<!-- claim {name} -->"


def statements(found: Reproduction) -> Iterator[str]:
    """What the paper says, and whether it holds here."""
    yield "## What the paper says of them\n"
    yield (
        "One seed each, so that none of these verdicts is final: means and rates are held against\n"
        "each other by 95 % intervals within that run; shares of variance or influence have none.\n"
    )
    yield "| the paper | here | on what that rests |\n|---|---|---|"
    for one in found.statements:
        yield f"| {one.paper} | {verdict(one)} | {one.figures} |"
    yield ""
