"""The store of most tests, in memory and empty; and the file that others are copied from."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from eigenfail_services.store.store import Store


@pytest.fixture
def store() -> "Iterator[Store]":
    """An empty store in memory; folders whose tests need another kind have a `store` of theirs."""
    from eigenfail_services.store.store import open_store

    with closing(open_store("memory://")) as opened:
        yield opened


@pytest.fixture(scope="session")
def sqlite_template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A database file with the schema and nothing else; copying it is quicker than migrating."""
    from eigenfail_services.store.store import open_store

    path = tmp_path_factory.mktemp("template") / "empty.db"
    open_store(f"sqlite:///{path}").close()
    return path
