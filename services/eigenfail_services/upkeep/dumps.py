"""Backups of PostgreSQL, made and read by its own programs."""

import os
import re
import shlex
import subprocess
from pathlib import Path

from sqlalchemy import URL, Connection, inspect, text

from eigenfail.errors import ServiceError
from eigenfail_services.store.engine import Database, find
from eigenfail_services.store.schema import VERSION_TABLE
from eigenfail_services.upkeep.refusals import HAS_ROWS, no_backup, not_empty

REVISION = re.compile(rf"^COPY [^\n]*{VERSION_TABLE}[^\n]* FROM stdin;\n(\S+)\n\\\.", re.MULTILINE)
PLAIN = ("--no-owner", "--no-privileges")
WHOLE = ("--single-transaction", "--exit-on-error", "--clean", "--if-exists")

OTHERS = text(
    "SELECT count(*) FROM pg_stat_activity WHERE datname = current_database() "
    "AND application_name = 'eigenfail' AND pid <> pg_backend_pid()"
)


class Dumps:
    """One database at a server."""

    def __init__(self, url: URL) -> None:
        self._backend = find(url.render_as_string(hide_password=False))
        secret = url.password or url.query.get("password")
        # Not an argument: everybody on the machine can read those.
        self._environment = os.environ | ({"PGPASSWORD": str(secret)} if secret else {})

    def save(self, draft: Path) -> None:
        """As of one moment: pg_dump reads in one transaction."""
        self._run("pg_dump", "--format=custom", *PLAIN, f"--file={draft}", self._target())

    def revision(self, file: Path) -> str:
        """The revision among the data of a dump."""
        words = ("--data-only", f"--table={VERSION_TABLE}", "--file=-", str(file))
        try:
            said = self._run("pg_restore", *words)
        except ServiceError as error:
            raise no_backup(file, error.problem.rstrip(".")) from error
        if found := REVISION.search(said):
            return found[1]
        raise no_backup(file, "it has no table of eigenfail's schema")

    def load(self, file: Path, *, force: bool) -> None:
        """In one transaction of PostgreSQL's."""
        database = Database(self._backend)
        try:
            with database.reading() as connection:
                self._refuse(connection, force)
        finally:
            database.close()
        self._run("pg_restore", *WHOLE, *PLAIN, self._target(), str(file))

    def _target(self) -> str:
        return f"--dbname={self._backend.address}"

    def _refuse(self, connection: Connection, force: bool) -> None:
        label = self._backend.label
        if connection.execute(OTHERS).scalar_one():
            raise ServiceError(f"A service uses {label}.", "Stop it, and try again.")
        names = HAS_ROWS.keys() & inspect(connection).get_table_names()
        for name in () if force else names:
            if connection.exec_driver_sql(HAS_ROWS[name]).scalar_one():
                raise not_empty(label)

    def _run(self, *words: str) -> str:
        """What a program of PostgreSQL's says.

        Raises:
            ServiceError: it is not installed, or fails.
        """
        command = f"Run: {shlex.join(words)}"
        try:
            done = subprocess.run(
                words, capture_output=True, text=True, check=False, env=self._environment
            )
        except FileNotFoundError:
            remedy = f"Install PostgreSQL's client programs, or do it where they are. {command}"
            raise ServiceError(f"{words[0]} is not installed here.", remedy) from None
        if done.returncode:
            raise ServiceError(f"{words[0]} failed: {in_one_line(done.stderr)}.", command)
        return done.stdout


def in_one_line(said: str) -> str:
    """What a program complained of."""
    return "; ".join(said.strip().splitlines()).rstrip(".") or "it says nothing"
