"""Vacuuming a database, and pruning the noise of its episodes."""

import os
import socket
import sqlite3
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from pathlib import Path
from shutil import disk_usage
from typing import Protocol

import msgspec
from sqlalchemy import Connection, func, inspect, select, text

from eigenfail.addresses import sqlite_path
from eigenfail.errors import Conflict, InvalidValue, ServiceError
from eigenfail.methods import traits_of
from eigenfail.values.campaign import FINAL_STATES, Campaign, CampaignFilter, CampaignState
from eigenfail.values.operations import PrunedCampaign, PruneReport, Retention, Vacuumed, Weight
from eigenfail_services.store import Store, open_store
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.engine import find_backend, read_kind, translate_errors
from eigenfail_services.store.errors import make_running_error
from eigenfail_services.store.schema import is_own_table
from eigenfail_services.upkeep import backup

TEMPORARY_VARIABLES = ("SQLITE_TMPDIR", "TMPDIR")


TEMPORARY_FOLDERS = ("/var/tmp", "/usr/tmp", "/tmp")  # noqa: S108 - where SQLite writes, in its order


class VacuumProgram(Protocol):
    """Vacuuming of one kind of database."""

    def size(self) -> int:
        """Return the size of the database on the disk. [bytes]"""

    def sweep(self) -> None:
        """Give free space back to the disk.

        Raises:
            ServiceError: the database is in use, or there is no room to work in.
        """


def vacuum(address: str) -> Vacuumed:
    """Give the space of deleted rows back to the disk.

    SQLite copies the database into a new file: it must not be in use meanwhile, and there must be
    room for both. PostgreSQL works while a service runs: space at the end of its files is given
    back, space between rows is used again.

    Raises:
        InvalidValue: the address is invalid.
        StoreUnavailable: there is no database, or it does not answer.
        SchemaMismatch: its schema is not this program's.
        ServiceError: the database is in use, or there is no room to work in.
    """
    # Opening it refuses a database that is not this program's, before its file is rewritten.
    open_store(address, migrate=False).close()
    sweeper = find_vacuum_program(address)
    before = sweeper.size()
    sweeper.sweep()
    return Vacuumed(find_backend(address).label, before, sweeper.size())


def find_vacuum_program(address: str) -> VacuumProgram:
    """Return the vacuum program for the database at an address that `find` has checked."""
    return VACUUM_PROGRAMS[read_kind(address)](address)


class SqliteVacuum:
    """Vacuuming of a SQLite database."""

    def __init__(self, address: str) -> None:
        self._path = sqlite_path(address)

    def size(self) -> int:
        """Return the size of the database file and of SQLite's companion files. [bytes]"""
        sizes = 0
        for ending in backup.FILE_SUFFIXES:
            with suppress(FileNotFoundError):
                sizes += self._path.with_name(self._path.name + ending).stat().st_size
        return sizes

    def sweep(self) -> None:
        """Rewrite the file, if no other program uses it: writers would wait in vain for minutes."""
        with (
            backup.translate_sqlite_errors(f"{self._path} was not changed"),
            closing(backup.open_sqlite(self._path, "rw", backup.LOCK_TIMEOUT_S)) as connection,
        ):
            # SQLite refuses to change the mode of a database that another program has open.
            connection.execute("PRAGMA journal_mode = DELETE")
            _require_space(self._path, connection)
            connection.execute("VACUUM")
            connection.execute("PRAGMA journal_mode = WAL")


def _require_space(path: Path, connection: sqlite3.Connection) -> None:
    """Raise ServiceError if there is no room for a second copy and for the journal."""
    asked = ("page_count", "freelist_count", "page_size")
    pages, free, each = (connection.execute(f"PRAGMA {name}").fetchone()[0] for name in asked)
    copy, journal = (pages - free) * each, pages * each
    scratch = _find_temporary_folder()
    for folder, needed in _list_needs(scratch, copy, path.parent, journal).items():
        if (there := disk_usage(folder).free) < needed:
            raise ServiceError(
                f"{path} needs {needed} bytes in {folder} to be written anew, and there are "
                f"{there}.",
                "Make room, or let SQLITE_TMPDIR name a folder on another disk.",
            )


def _list_needs(scratch: Path, copy: int, home: Path, journal: int) -> Mapping[Path, int]:
    """Return the bytes that each folder needs; on one disk the sum of both."""
    if scratch.stat().st_dev == home.stat().st_dev:
        return {home: copy + journal}
    return {scratch: copy, home: journal}


def _find_temporary_folder() -> Path:
    """Return the folder in which SQLite writes the copy: the first that it can write in."""
    named = (os.environ.get(name) for name in TEMPORARY_VARIABLES)
    for place in map(Path, (*filter(None, named), *TEMPORARY_FOLDERS)):
        if place.is_dir() and os.access(place, os.W_OK | os.X_OK):
            return place
    return Path()


class PostgresVacuum:
    """Vacuuming of a PostgreSQL database."""

    def __init__(self, address: str) -> None:
        self._backend = find_backend(address)
        engine = self._backend.schema_engine()
        # VACUUM cannot run inside a transaction.
        self._engine = engine.execution_options(isolation_level="AUTOCOMMIT")

    def size(self) -> int:
        """Return the size of eigenfail's tables and their indexes. [bytes]"""
        with translate_errors(self._backend), self._engine.connect() as connection:
            return sum(_measure_table(connection, name) for name in _list_tables(connection))

    def sweep(self) -> None:
        """Vacuum table by table, and update the statistics of the query planner."""
        with translate_errors(self._backend), self._engine.connect() as connection:
            for name in _list_tables(connection):
                connection.execute(text(f'VACUUM (ANALYZE) "{name}"'))


def _list_tables(connection: Connection) -> list[str]:
    """Return the names of the tables of eigenfail and of plug-ins."""
    return sorted(filter(is_own_table, inspect(connection).get_table_names()))


def _measure_table(connection: Connection, table: str) -> int:
    """Return the size of a table with its indexes and large values. [bytes]"""
    size: int = connection.execute(select(func.pg_total_relation_size(table))).scalar_one()
    return size


VACUUM_PROGRAMS: Mapping[str, Callable[[str], VacuumProgram]] = {
    "sqlite": SqliteVacuum,
    "postgresql": PostgresVacuum,
    "postgres": PostgresVacuum,
}


PAGE = 200


DAY_MS = 86_400_000
"""Ages of campaigns are given in days, and their ends are stored in milliseconds."""


class PruneSelection(msgspec.Struct, frozen=True):
    """The campaigns to prune.

    Attributes:
        campaigns: their ids; empty for all.
        older_than_days: least number of days since they ended.
    """

    campaigns: tuple[int, ...] = ()
    older_than_days: float = 0.0


class CampaignPruning(msgspec.Struct, frozen=True):
    """The noise to remove from a campaign, and whether other campaigns need the rest."""

    campaign: Campaign
    weight: Weight
    in_use: bool


def rehearse(address: str, rule: Retention, which: PruneSelection) -> PruneReport:
    """Report what a pruning would remove, without removing it.

    Raises:
        InvalidValue: the address is invalid, or a named campaign holds evidence.
        NotFound: a named campaign does not exist.
        Conflict: a named campaign has not ended.
        StoreUnavailable: there is no database, or it does not answer.
        SchemaMismatch: its schema is not this program's.
    """
    with closing(open_store(address, migrate=False)) as store:
        in_use = store.retention.in_use()
        found = [
            CampaignPruning(each, Weight(), True)
            if each.id in in_use
            else CampaignPruning(each, store.retention.weigh(each.id, rule), False)
            for each in _find_campaigns(store, which)
        ]
    return _make_report(address, rule, found, is_rehearsal=True)


def prune(address: str, rule: Retention, which: PruneSelection) -> PruneReport:
    """Remove noise and record that; raises what `rehearse` does, and StoreUnwritable."""
    who = _find_user()
    with closing(open_store(address, migrate=False)) as store:
        # All campaigns are found before the first is pruned: a wrong name is refused while nothing
        # has been deleted.
        found = [
            _prune_campaign(store, each, rule, who) for each in list(_find_campaigns(store, which))
        ]
    return _make_report(address, rule, found, is_rehearsal=False)


def _make_report(
    address: str, rule: Retention, found: Sequence[CampaignPruning], *, is_rehearsal: bool
) -> PruneReport:
    """Return the report, without campaigns of which nothing is removed."""
    return PruneReport(
        find_backend(address).label,
        rule,
        is_rehearsal,
        tuple(
            PrunedCampaign(each.campaign.id, each.campaign.spec.name, each.weight)
            for each in found
            if each.weight.episodes
        ),
        tuple(each.campaign.id for each in found if each.in_use),
    )


def _prune_campaign(store: Store, campaign: Campaign, rule: Retention, who: str) -> CampaignPruning:
    """Prune a campaign slice by slice, until other campaigns need the rest.

    The pauses leave other writers at least half of the time.
    """
    weight, begun = Weight(), None
    while True:
        before_s = time.monotonic()
        try:
            record = store.retention.prune(campaign.id, rule, who, begun)
        except Conflict:  # it has ended, for good: so it is this
            return CampaignPruning(campaign, weight, True)
        if record is None:
            return CampaignPruning(campaign, weight, False)
        weight, begun = record.weight, record.id
        time.sleep(time.monotonic() - before_s)


def _find_user() -> str:
    """Return the user and the machine, for the record."""
    user = os.environ.get("USER") or f"user {os.getuid()}"
    return f"{user}@{socket.gethostname()}"


def _find_campaigns(store: Store, which: PruneSelection) -> Iterator[Campaign]:
    """Yield the selected campaigns that may lose noise."""
    before_ms = now_ms() - which.older_than_days * DAY_MS
    for campaign in _find_named(store, which.campaigns) if which.campaigns else _list_ended(store):
        if campaign.ended_ms is not None and campaign.ended_ms <= before_ms:
            yield campaign


def _find_named(store: Store, wanted: tuple[int, ...]) -> Iterator[Campaign]:
    """Yield the named campaigns.

    Raises:
        NotFound: one does not exist.
        Conflict: one has not ended.
        InvalidValue: one holds evidence.
    """
    for number in wanted:
        campaign = store.campaigns.get(number)
        if campaign.state not in FINAL_STATES:
            raise make_running_error(campaign)
        if traits_of(campaign.spec.method).is_evidence:
            problem = f"{number} is one of {campaign.spec.method}: its noise is a proof."
            raise InvalidValue("campaign", problem, "Its few episodes are kept whole.")
        yield campaign


def _list_ended(store: Store) -> Iterator[Campaign]:
    """Yield all campaigns that have ended, except those that hold evidence."""
    for state in sorted(FINAL_STATES):
        for campaign in _list_in_state(store, state):
            if not traits_of(campaign.spec.method).is_evidence:
                yield campaign


def _list_in_state(store: Store, state: CampaignState) -> Iterator[Campaign]:
    """Yield all campaigns of a state, newest first."""
    page = store.campaigns.page(PAGE, where=CampaignFilter(state=state))
    yield from page.items
    while page.next is not None:
        page = store.campaigns.page(PAGE, page.next, CampaignFilter(state=state))
        yield from page.items
