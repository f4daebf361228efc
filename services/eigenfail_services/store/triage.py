"""Triage of failure modes, each change with the name of its author."""

from collections.abc import Callable

from sqlalchemy import Connection, select, update

from eigenfail.values.triage import Triage, TriageChange, change_triage
from eigenfail_services.store.analyses import require_analysis
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.codec import StructRows
from eigenfail_services.store.engine import Database
from eigenfail_services.store.errors import make_mode_error
from eigenfail_services.store.schema import modes

_ROWS = StructRows(modes, Triage)


def accept(_triage: Triage) -> None:
    """Let any triage be changed."""


class TriageStore:
    """Triage of failure modes, which lies in their rows."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def get(self, analysis: int, number: int) -> Triage:
        """Return the triage of a mode of an analysis.

        Raises:
            NotFound: no such analysis or mode.
        """
        with self._database.reading() as connection:
            return _read(connection, analysis, number)

    def change(
        self,
        analysis: int,
        number: int,
        change: TriageChange,
        who: str,
        check: Callable[[Triage], None] = accept,
    ) -> Triage:
        """Change the triage of a mode, and return it.

        Args:
            analysis: id of the analysis.
            number: number of the mode, from 1.
            change: what changes.
            who: name of who makes the change.
            check: raises an error if the current triage is not the one to be changed; no other
                change comes between.

        Raises:
            NotFound: no such analysis or mode.
        """
        with self._database.writing() as connection:
            before = _read(connection, analysis, number, lock=True)
            check(before)
            after = change_triage(before, change, now_ms(), who)
            values = {name: getattr(after, name) for name in Triage.__struct_fields__}
            connection.execute(
                update(modes)
                .where(modes.c.analysis == analysis, modes.c.number == number)
                .values(values)
            )
        return after


def _read(connection: Connection, analysis: int, number: int, *, lock: bool = False) -> Triage:
    query = select(*_ROWS.columns).where(modes.c.analysis == analysis, modes.c.number == number)
    # Changes of one mode come one after the other: each sees what the one before has written.
    found = _ROWS.first(connection, query.with_for_update() if lock else query)
    if found is None:
        require_analysis(connection, analysis)
        raise make_mode_error(analysis, number)
    return found
