"""The conformance suite of `Store`.

@pytest.mark.parametrize("check", STORE_CHECKS)
def test_my_store(check, empty_store):
    check(empty_store)

Each check wants a store of its own, empty.
"""

from collections.abc import Callable

from eigenfail.contracts import Store
from eigenfail.testing.store import (
    access,
    batches,
    blocks,
    campaigns,
    conflicts,
    crowds,
    deaths,
    episode_filters,
    episode_lists,
    episodes,
    fencing,
    figures,
    jobs,
    moves,
    priorities,
    quotas,
    records,
    retention,
    roster,
    safety,
    suites,
)

STORE_CHECKS: tuple[Callable[[Store], None], ...] = (
    *campaigns.CHECKS,
    *moves.CHECKS,
    *batches.CHECKS,
    *suites.CHECKS,
    *episodes.CHECKS,
    *deaths.CHECKS,
    *episode_lists.CHECKS,
    *episode_filters.CHECKS,
    *conflicts.CHECKS,
    *blocks.CHECKS,
    *safety.CHECKS,
    *figures.CHECKS,
    *jobs.CHECKS,
    *fencing.CHECKS,
    *records.CHECKS,
    *retention.CHECKS,
    *access.CHECKS,
    *priorities.CHECKS,
    *quotas.CHECKS,
    *roster.CHECKS,
    *crowds.CHECKS,
)
"""One behaviour each; raise AssertionError where it is broken."""
