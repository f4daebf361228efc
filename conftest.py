"""Fixtures of all tests, of the core and of the plug-ins."""

import gc
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

sys.path += [
    str(Path(__file__).parent / "tests" / name) for name in ("chaos", "plugins", "support")
]

# As in the processes of a service; set before numpy is loaded. Tests side by side that each have a
# thread for every core spend ten times as long in K-means: idle threads of OpenMP wait in a loop.
os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")

# Tests put doubles in place of functions, which compiled code calls directly: this process
# interprets the episode loop. Processes that tests start have the compiled one, as in use, which
# takes a third of the time. workers/test_compilation.py: both give the same results.
if "EIGENFAIL_INTERPRETED" not in os.environ:
    os.environ["EIGENFAIL_INTERPRETED"] = "1"
    import eigenfail_workers  # noqa: F401 - it looks at the variable, once

    del os.environ["EIGENFAIL_INTERPRETED"]

import deadlines
from postgresql import start_server

pytest_plugins = ["proofs", "golden", "memory_store", "plugin_absence", "tiny_formats"]

# A loaded machine fails no test: neither a deadline nor a slow draw is a fault.
settings.register_profile("here", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("here")

# Plug-ins of strangers and what tests share, for the processes that tests start as well.
FOLDERS = [f"{Path(__file__).parent}/tests/{name}" for name in ("plugins", "support")]
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [os.environ.get("PYTHONPATH"), *FOLDERS]))
os.environ["EIGENFAIL_FUNCTIONS"] = "any_function,eigenfail_planes,eigenfail_sleeping"

# `make` does this, too. Without compiled files, each process of a test would compile all sources.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
gc.disable()  # until all tests are collected, which stay


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_setupnodes() -> None:
    """Collect garbage in the process that hands out tests: it collects none."""
    gc.enable()


LONG = ("service", "browser")
"""Marks of tests that wait for processes, for a minute or more in one file."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that take longest, and give each test its time limit.

    A process that is alone with a long file at the end would hold up all others.
    """
    gc.freeze()
    gc.enable()
    long = {item.path for item in items if any(map(item.get_closest_marker, LONG))}
    items.sort(key=lambda item: item.path not in long)
    for item in items:
        is_asked_for = item.config.getoption("timeout") is not None
        if not is_asked_for and item.get_closest_marker("timeout") is None:
            item.add_marker(pytest.mark.timeout(deadlines.TEST_S))


class Postgres:
    """A PostgreSQL server of this session's own, and databases in it."""

    def __init__(self, folder: str) -> None:
        self._server = start_server(folder)
        self._numbers = count(1)
        self.run("ALTER SYSTEM SET fsync = off", "SELECT pg_reload_conf()")

    def run(self, *statements: str) -> None:
        """Run statements as the administrator."""
        import psycopg

        with psycopg.connect(self._server.get_uri(), autocommit=True) as connection:
            for statement in statements:
                connection.execute(statement)

    @contextmanager
    def database(self, template: str = "template0") -> Iterator[str]:
        """The address of a new database, which is gone afterwards."""
        name = f"test_{next(self._numbers)}"
        self.run(f"CREATE DATABASE {name} TEMPLATE {template}")
        yield self._server.get_uri(database=name)
        self.run(f"DROP DATABASE {name} WITH (FORCE)")

    def stop(self) -> None:
        """End the server, and remove what it kept."""
        self._server.cleanup()


@pytest.fixture(scope="session")
def postgres() -> Iterator[Postgres]:
    """The server. Its folder has a short name, as paths of sockets must."""
    folder = tempfile.mkdtemp(prefix="eigenfail-pg-", dir="/tmp")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", folder)
        server = Postgres(folder)
    yield server
    server.stop()


@pytest.fixture
def postgres_url(postgres: Postgres) -> Iterator[str]:
    """The address of an empty PostgreSQL database."""
    with postgres.database() as url:
        yield url
