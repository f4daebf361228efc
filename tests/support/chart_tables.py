"""Tables behind charts, as a page shows them."""

from eigenfail.presentation.tables import Table


def read_rows(table: Table) -> tuple[tuple[str, ...], ...]:
    """Return the cells of a table as text."""
    return tuple(tuple(cell.line for cell in row) for row in table.cells)


def read_headings(table: Table) -> tuple[str, ...]:
    """Return the heads of the columns of a table, with their units."""
    return tuple(column.heading for column in table.columns)
