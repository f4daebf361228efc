"""What SQLite itself says of its file."""

from collections.abc import Iterator

from sqlalchemy import Connection
from sqlalchemy.exc import DatabaseError

from eigenfail.values.upkeep import Defect
from eigenfail_services.upkeep.checks import RESTORE, Question

FINE = "ok"


def pages(connection: Connection) -> Iterator[Defect]:
    """Pages of the file that are not in order."""
    try:
        for (found,) in connection.exec_driver_sql("PRAGMA quick_check"):
            if found != FINE:
                yield Defect("file", f"{found}.", RESTORE)
    except DatabaseError as error:
        connection.rollback()  # nothing can be committed any more, not even nothing
        yield Defect("file", f"It cannot be read to its end: {error.orig}.", RESTORE)


def references(connection: Connection) -> Iterator[Defect]:
    """Rows that refer to rows that are not there."""
    for table, row, parent, _ in connection.exec_driver_sql("PRAGMA foreign_key_check"):
        yield Defect(f"{table}, row {row}", f"It belongs to no row of {parent}.", RESTORE)


PAGES = Question("file", "SQLite finds every page of the file in order.", pages)
REFERENCES = Question("references", "Every row has the row that it belongs to.", references)
