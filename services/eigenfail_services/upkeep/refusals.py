"""What is refused of any kind of database, in one wording."""

from collections.abc import Mapping
from pathlib import Path

from sqlalchemy import exists, literal_column, select

from eigenfail.errors import Conflict, InvalidValue
from eigenfail_services.store.schema import event_counter, metadata

HAS_ROWS: Mapping[str, str] = {
    table.name: str(select(exists(select(literal_column("1")).select_from(table))))
    for table in metadata.sorted_tables
    if table is not event_counter
}
"""Whether a table has a row, as SQL; of all those that have none in an empty database."""


def no_backup(file: Path, why: str) -> InvalidValue:
    """The file cannot be restored."""
    remedy = "Name one that `eigenfail db backup` made from the same kind of database."
    return InvalidValue("file", f"'{file}' is no backup of eigenfail: {why}.", remedy)


def not_empty(database: str) -> Conflict:
    """What is in a database would be lost."""
    return Conflict(
        f"{database} is not empty.",
        "Restore into another one, or say --force: what is in this one is then lost.",
    )
