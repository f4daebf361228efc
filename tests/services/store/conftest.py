"""Stores of every kind, each test's own and empty."""

import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from eigenfail_services.store.store import Store, open_store

sys.path.append(str(Path(__file__).parent))


@pytest.fixture(scope="session")
def postgres_template(postgres) -> Iterator[str]:
    """The name of a database with the schema and nothing else."""
    with postgres.database() as url:
        open_store(url).close()
        yield re.search(r"/(test_\d+)\?", url)[1]


@pytest.fixture
def sqlite_url(sqlite_template, tmp_path) -> str:
    """The address of a SQLite database with the schema and nothing else."""
    shutil.copy(sqlite_template, tmp_path / "eigenfail.db")
    return f"sqlite:///{tmp_path / 'eigenfail.db'}"


@pytest.fixture
def prepared_postgres_url(postgres, postgres_template) -> Iterator[str]:
    """The address of a PostgreSQL database with the schema and nothing else."""
    with postgres.database(postgres_template) as url:
        yield url


@pytest.fixture
def strace() -> Callable[[str], list[str]]:
    """Words before a command: a fault befalls it as it asks that something be brought to disk."""

    def words(fault: str) -> list[str]:
        calls = "fsync,fdatasync"
        faults = ["-e", f"trace={calls}", "-e", f"inject={calls}:{fault}"]
        return ["strace", "-f", "-qq", "-o", "/dev/null", *faults]

    try:
        subprocess.run([*words("error=EIO:when=1..2"), "true"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("no strace that may look into processes, and knows ranges")
    return words


@pytest.fixture(params=["sqlite_url", "prepared_postgres_url"])
def url(request) -> str:
    """The address of a database with the schema and nothing else."""
    return request.getfixturevalue(request.param)


@pytest.fixture
def sql_store(url) -> Iterator[Store]:
    """An empty store in a database."""
    store = open_store(url)
    yield store
    store.close()


@pytest.fixture(params=["memory", "sqlite_url", "prepared_postgres_url"])
def store(request) -> Iterator[Store]:
    """An empty store of each kind."""
    if request.param == "memory":
        yield open_store("memory://")
        return
    store = open_store(request.getfixturevalue(request.param))
    yield store
    store.close()
