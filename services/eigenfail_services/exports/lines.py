"""Episodes as text, one line each, made while they are read."""

import csv
import io
from collections.abc import Iterator

import msgspec

from eigenfail.filters import COLUMNS, Kind, Value
from eigenfail_services.exports.selection import Source, cells, picked, portions

FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""How a text begins that a spreadsheet would take for a formula, and compute."""


def ndjson(source: Source) -> Iterator[bytes]:
    """One JSON object a line, some lines at a time."""
    columns = source.wanted.columns
    encoder = msgspec.json.Encoder()
    for rows in portions(source):
        yield encoder.encode_lines([picked(row, columns) for row in rows])


def csv_lines(source: Source) -> Iterator[bytes]:
    """A line of names, then one for each episode, some at a time; what is missing is empty."""
    columns = source.wanted.columns
    texts = [COLUMNS[column].kind is Kind.TEXT for column in columns]
    yield written([list(columns)])
    for rows in portions(source):
        found = (zip(cells(row, columns), texts, strict=True) for row in rows)
        yield written([[cell(value, is_text) for value, is_text in line] for line in found])


def cell(value: Value | None, is_text: bool) -> str:
    """A value in a table; a text is never a formula."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    words = str(value)
    return f"'{words}" if is_text and words.startswith(FORMULA) else words


def written(lines: list[list[str]]) -> bytes:
    """The bytes of some lines of a table."""
    text = io.StringIO()
    csv.writer(text).writerows(lines)
    return text.getvalue().encode()
