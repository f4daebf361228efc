"""Every number of a reproduction under a name of its own, so that documents can quote it."""

import re
from collections.abc import Iterator

import msgspec

from eigenfail.reproduction.results import Column, PaperTable, Reproduction, Row
from eigenfail.values import Interval


class Claim(msgspec.Struct, frozen=True):
    """One number that may be quoted; see `results.Number`."""

    value: float | None
    unit: str
    n: int
    interval: Interval | None = None
    paper: float | None = None


def claims(found: Reproduction) -> dict[str, Claim]:
    """By names such as "paper.evaluation.ast_evaluation.failure_rate"."""
    return dict(claim for table in found.tables for claim in of_table(table))


def of_table(table: PaperTable) -> Iterator[tuple[str, Claim]]:
    """The numbers of a table that rest on something."""
    for row in table.rows:
        for column, number in zip(table.columns, row.numbers, strict=True):
            if number.n:
                claim = Claim(number.value, column.unit, number.n, number.interval, number.paper)
                yield claim_name(table, row, column), claim


def claim_name(table: PaperTable, row: Row, column: Column) -> str:
    """The name of a table's number."""
    return f"paper.{table.name}.{short(row.name)}.{column.name}"


def short(name: str) -> str:
    """A row's name without what a claim's name may not hold."""
    return re.sub(r"[^a-z0-9.+-]+", "_", name.lower())
