"""A reproduction as files: the page, the numbers, and a CSV file for each table."""

import csv
import io
from collections.abc import Iterator

import msgspec

from eigenfail.reproduction.claims import claims
from eigenfail.reproduction.page import page
from eigenfail.reproduction.results import Number, PaperTable, Reproduction


def files(found: Reproduction) -> dict[str, bytes]:
    """Contents by name: paper.md, paper.json, claims.json, tables/paper-*.csv."""
    return {
        "paper.md": page(found).encode(),
        "paper.json": readable(found),
        "claims.json": readable(claims(found)),
        **{f"tables/paper-{table.name}.csv": comma_separated(table) for table in found.tables},
    }


def readable(value: object) -> bytes:
    """JSON on many lines."""
    return msgspec.json.format(msgspec.json.encode(value), indent=2) + b"\n"


def comma_separated(table: PaperTable) -> bytes:
    """Unrounded: of each column the number, its n, its interval and the paper's."""
    written = io.StringIO()
    writer = csv.writer(written, lineterminator="\n")
    parts = ("", "_n", "_low", "_high", "_paper")
    writer.writerow(
        ["row", *(f"{column.name}{part}" for column in table.columns for part in parts)]
    )
    for row in table.rows:
        writer.writerow([row.name, *(cell for number in row.numbers for cell in cells(number))])
    return written.getvalue().encode()


def cells(number: Number) -> Iterator[float | None]:
    """A number with all that belongs to it."""
    ends = number.interval
    yield from (number.value, number.n)
    yield from (ends.low, ends.high) if ends else (None, None)
    yield number.paper
