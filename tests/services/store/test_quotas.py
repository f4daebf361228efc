"""Quotas where many ask at once, and as time goes by; ageing in the queue."""

from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import pytest
from accepted import accept_spec
from store_checks.examples import equal
from store_checks.quotas import key_with

from eigenfail.errors import QuotaExceeded
from eigenfail.testing.examples import spec
from eigenfail.values.access import Quotas, Usage
from eigenfail.values.campaign_spec import Priority
from eigenfail_services.store import access, campaign_rows, campaigns, jobs
from eigenfail_services.store.access import DAY_MS
from eigenfail_services.store.store import open_store

AT_ONCE = 8
LONG_S = 600.0
HOUR_MS = 3_600_000


@pytest.mark.fault(
    "quota exceeded, also by concurrent requests",
    group="api",
    outcome="A 403 that names the [quota](security.md#quotas); exactly as many requests pass "
    "as are allowed.",
)
@pytest.mark.parametrize(
    ("allowed", "fit"),
    [(Quotas(max_open=5), 5), (Quotas(max_episodes_per_day=35), 3)],
    ids=["open", "episodes"],
)
def test_of_many_requests_at_once_as_many_pass_as_are_allowed(url, allowed, fit) -> None:
    stores = [open_store(url) for _ in range(AT_ONCE)]
    key = key_with(stores[0], allowed)
    together = Barrier(AT_ONCE)

    def ask(store) -> list[bool]:
        together.wait()
        return [made(store, key) for _ in range(3)]

    with ThreadPoolExecutor(AT_ONCE) as pool:
        passed = [each for answers in pool.map(ask, stores) for each in answers]
    assert passed.count(True) == fit
    assert stores[0].keys.usage([key]) == {key: Usage(fit, 10 * fit)}
    for store in stores:
        store.close()


def made(store, key) -> bool:
    try:
        store.campaigns.create(accept_spec(spec()), made_by=key)
    except QuotaExceeded:
        return False
    return True


class Calendar:
    """The time of all stores, set by hand."""

    def __init__(self) -> None:
        self.at_ms = 1_700_000_000_000

    def __call__(self) -> int:
        return self.at_ms


@pytest.fixture
def calendar(monkeypatch) -> Calendar:
    found = Calendar()
    for reader in (campaign_rows, campaigns, jobs, access):
        monkeypatch.setattr(reader, "now_ms", found)
    return found


def test_what_was_made_a_day_ago_no_longer_counts(calendar, store) -> None:
    key = key_with(store, Quotas(max_episodes_per_day=10))
    store.campaigns.create(accept_spec(spec()), made_by=key)
    calendar.at_ms += DAY_MS - 1
    assert not made(store, key)
    calendar.at_ms += 1
    assert made(store, key)
    equal(store.keys.usage([key])[key], Usage(2, 10), "What is open, and what is of the last day")


def claimed(store) -> int:
    job = store.jobs.claim("a", LONG_S)
    assert job is not None
    return job.subject


def test_nothing_that_comes_two_hours_later_passes_a_campaign_of_low_priority(
    calendar, store
) -> None:
    low = store.campaigns.create(accept_spec(spec(priority=Priority.LOW))).id
    urgent = []
    for _ in range(5):  # one every half an hour, for ever
        urgent.append(store.campaigns.create(accept_spec(spec(priority=Priority.HIGH))).id)
        calendar.at_ms += HOUR_MS // 2
    later = store.campaigns.create(accept_spec(spec(priority=Priority.HIGH))).id
    order = [claimed(store) for _ in range(7)]
    assert order == [*urgent[:4], low, urgent[4], later]


def test_a_step_of_priority_is_worth_an_hour(calendar, store) -> None:
    first = store.campaigns.create(accept_spec(spec(priority=Priority.LOW))).id
    calendar.at_ms += HOUR_MS - 1
    second = store.campaigns.create(accept_spec(spec())).id
    calendar.at_ms += 2
    third = store.campaigns.create(accept_spec(spec())).id
    assert [claimed(store) for _ in range(3)] == [second, first, third]
