"""Charts as a browser receives them, and the tables behind them, as a page shows them."""

import json

from eigenfail.presentation.tables import Table
from eigenfail_api.dashboard.charts import Chart
from eigenfail_api.dashboard.rendering import to_json


def read_data(chart: Chart) -> dict:
    """Return the data that the browser draws."""
    return json.loads(to_json(chart.data))


def read_rows(table: Table) -> tuple[tuple[str, ...], ...]:
    """Return the cells of a table as text."""
    return tuple(tuple(cell.line for cell in row) for row in table.cells)


def read_headings(table: Table) -> tuple[str, ...]:
    """Return the heads of the columns of a table, with their units."""
    return tuple(column.heading for column in table.columns)
