"""The tables of a report as CSV, for spreadsheets and programs."""

import csv
import io

from eigenfail.values.report import Cell, ReportTable

FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""What a spreadsheet takes for the beginning of a formula, if a user's text begins with it."""


def to_csv(table: ReportTable) -> bytes:
    """UTF-8 with a header of column names; numbers as exact as they are, nothing for None.

    Text that a spreadsheet would run as a formula has an apostrophe before it.
    """
    file = io.StringIO(newline="")
    writer = csv.writer(file)
    writer.writerow([column.name for column in table.columns])
    writer.writerows([[written(cell) for cell in row] for row in table.rows])
    return file.getvalue().encode()


def written(cell: Cell) -> str:
    """A cell as text."""
    if cell is None:
        return ""
    if isinstance(cell, bool):
        return "true" if cell else "false"
    if isinstance(cell, str):
        return f"'{cell}" if cell.startswith(FORMULA) else cell
    return repr(cell)
