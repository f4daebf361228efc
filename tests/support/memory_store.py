"""The store of most tests: in memory, empty, and each test's own."""

from collections.abc import Iterator
from contextlib import closing
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
