"""Every store keeps the contract."""

import pytest

from eigenfail.testing.store import STORE_CHECKS


@pytest.mark.parametrize("check", STORE_CHECKS, ids=lambda check: check.__name__)
def test_store(check, store) -> None:
    check(store)
