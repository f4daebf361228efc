"""Databases to migrate, and a look into them."""

from contextlib import closing

import pytest

from eigenfail_services.store import migrate
from eigenfail_services.store.engine import Database, find_backend


@pytest.fixture(autouse=True)
def no_plugin_tables(monkeypatch):
    """The schema of the core alone, whatever is installed."""
    monkeypatch.setattr(migrate, "load_plugin_tables", dict)


@pytest.fixture(params=["sqlite", "postgres"])
def url(request, tmp_path) -> str:
    """The address of an empty database."""
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'a.db'}"
    return request.getfixturevalue("postgres_url")


@pytest.fixture
def look():
    """Asks a database, with nothing of the store in between."""

    def look(url, question):
        with closing(Database(find_backend(url))) as database, database.reading() as connection:
            return question(connection)

    return look
