"""The conformance suite of `Store`.

@pytest.mark.parametrize("check", STORE_CHECKS)
def test_my_store(check, empty_store):
    check(empty_store)

Each check wants a store of its own, empty.
"""

from collections.abc import Callable

from eigenfail.contracts import Store
from eigenfail.testing.store import (
    blocks,
    campaigns,
    conflicts,
    crowds,
    episode_lists,
    episodes,
    jobs,
    records,
    safety,
)

STORE_CHECKS: tuple[Callable[[Store], None], ...] = (
    *campaigns.CHECKS,
    *episodes.CHECKS,
    *episode_lists.CHECKS,
    *conflicts.CHECKS,
    *blocks.CHECKS,
    *safety.CHECKS,
    *jobs.CHECKS,
    *records.CHECKS,
    *crowds.CHECKS,
)
"""One behaviour each; raise AssertionError where it is broken."""
