"""Checks that the store passes on every database.

Each check gets an empty store of its own.
"""

from collections.abc import Callable

from eigenfail_services.store.store import Store
from store_checks import (
    access,
    archive,
    batches,
    blocks,
    campaigns,
    conflicts,
    crowds,
    deaths,
    episode_filters,
    episode_lists,
    episodes,
    failures,
    fencing,
    figures,
    gates,
    jobs,
    labels,
    modes,
    moves,
    priorities,
    quotas,
    records,
    requirements,
    retention,
    roster,
    safety,
    suites,
    triage,
)

STORE_CHECKS: tuple[Callable[[Store], None], ...] = (
    *campaigns.CHECKS,
    *moves.CHECKS,
    *archive.CHECKS,
    *batches.CHECKS,
    *suites.CHECKS,
    *labels.CHECKS,
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
    *modes.CHECKS,
    *triage.CHECKS,
    *failures.CHECKS,
    *requirements.CHECKS,
    *retention.CHECKS,
    *access.CHECKS,
    *priorities.CHECKS,
    *quotas.CHECKS,
    *roster.CHECKS,
    *gates.CHECKS,
    *crowds.CHECKS,
)
"""One behaviour each; raise AssertionError where it is broken."""
