"""What the tests of the plug-in share."""

from pathlib import Path

import pytest

from eigenfail_services.store import open_store

PLUGIN = Path(__file__).parents[1]


@pytest.fixture(scope="session")
def plugin():
    """The folder of the plug-in."""
    return PLUGIN


@pytest.fixture
def store():
    """An empty store in memory, which has the tables of the plug-in."""
    store = open_store("memory://")
    yield store
    store.close()
