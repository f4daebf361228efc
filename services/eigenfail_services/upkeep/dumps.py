"""Backups of PostgreSQL, made and read by its own programs."""

import os
import re
import shlex
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

from sqlalchemy import URL, Connection, inspect, text

from eigenfail.errors import ServiceError
from eigenfail_services.store.engine import Database, find
from eigenfail_services.store.migrate import version
from eigenfail_services.store.schema import VERSION_TABLE, metadata
from eigenfail_services.store.steps import refuse_newer
from eigenfail_services.upkeep.refusals import HAS_ROWS, no_backup, not_empty

REVISION = re.compile(rf"^COPY [^\n]*{VERSION_TABLE}[^\n]* FROM stdin;\n(\S+)\n\\\.", re.MULTILINE)
PLAIN = ("--no-owner", "--no-privileges")
# What most of it is made of, noise in hexadecimal digits, comes to no less by more effort.
LIGHTLY = "--compress=1"
SCRIPT = ("--clean", "--if-exists", "--file=-")
STRICT = ("--no-psqlrc", "--quiet", "--set=ON_ERROR_STOP=1")

OURS = ", ".join(f'"{name}"' for name in (*metadata.tables, VERSION_TABLE))
# Not only what the backup has: younger tables refer to older ones, and would be in the way of the
# migrations that make them.
EMPTY = f"BEGIN; SET LOCAL client_min_messages = warning; DROP TABLE IF EXISTS {OURS}"

LEFT = "The database was left as it is. Check the rights of its user, and the room on its disk."

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

    def holds(self, _file: Path) -> bool:
        """Never: its files are the server's."""
        return False

    def save(self, draft: Path) -> None:
        """As of one moment: pg_dump reads in one transaction."""
        self._run("pg_dump", "--format=custom", LIGHTLY, *PLAIN, f"--file={draft}", self._target())

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
        with closing(Database(self._backend)) as database, database.reading() as connection:
            self._refuse(connection, force)
        self._replace(("pg_restore", *SCRIPT, *PLAIN, str(file)))

    def _target(self) -> str:
        return f"--dbname={self._backend.address}"

    def _refuse(self, connection: Connection, force: bool) -> None:
        label = self._backend.label
        if connection.execute(OTHERS).scalar_one():
            raise ServiceError(f"A service uses {label}.", "Stop it, and try again.")
        refuse_newer(version(connection), label)  # it has tables that nobody here knows
        names = HAS_ROWS.keys() & inspect(connection).get_table_names()
        for name in () if force else names:
            if connection.exec_driver_sql(HAS_ROWS[name]).scalar_one():
                raise not_empty(label)

    def _replace(self, reader: Sequence[str]) -> None:
        """Drop our tables and run the script that a program writes: all of it, or nothing.

        Raises:
            ServiceError: a program is not installed, or fails.
        """
        writer = ("psql", *STRICT, f"--command={EMPTY}", "--file=-", self._target())
        with installed(writer[0]), self._psql(writer) as psql:
            read = subprocess.run(
                reader, stdout=psql.stdin, stderr=subprocess.PIPE, text=True, check=False
            )
            # Without this word psql ends, and the server undoes everything.
            _, complaint = psql.communicate("" if read.returncode else "COMMIT;\n")
        if psql.returncode:
            raise failed("psql", complaint, LEFT)
        if read.returncode:
            raise failed(reader[0], read.stderr, LEFT)

    def _psql(self, words: Sequence[str]) -> "subprocess.Popen[str]":
        return subprocess.Popen(
            words,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            env=self._environment,
        )

    def _run(self, *words: str) -> str:
        """What a program of PostgreSQL's says.

        Raises:
            ServiceError: it is not installed, or fails.
        """
        command = f"Run: {shlex.join(words)}"
        with installed(words[0], command):
            done = subprocess.run(
                words, capture_output=True, text=True, check=False, env=self._environment
            )
        if done.returncode:
            raise failed(words[0], done.stderr, command)
        return done.stdout


@contextmanager
def installed(program: str, instead: str = "") -> Iterator[None]:
    """Raises ServiceError where a program is missing; `instead` is what to run elsewhere."""
    try:
        yield
    except FileNotFoundError:
        remedy = f"Install PostgreSQL's client programs, or do it where they are. {instead}"
        raise ServiceError(f"{program} is not installed here.", remedy.strip()) from None


def failed(program: str, said: str, remedy: str) -> ServiceError:
    """The error for people, with what a program complained of in one line."""
    complaint = "; ".join(said.strip().splitlines()).rstrip(".") or "it says nothing"
    return ServiceError(f"{program} failed: {complaint}.", remedy)
