"""The clock of leases: nobody who sets a clock frees a living job or blocks a lost one."""

from collections.abc import Iterator
from types import SimpleNamespace

import pytest
from sqlalchemy import update
from store_checks.examples import running
from store_checks.jobs import LONG_S, claimed

from eigenfail.values.records import JobKind
from eigenfail_services.store import clock
from eigenfail_services.store.schema import jobs
from eigenfail_services.store.store import Store, open_store

HOUR_S = 3_600
LEASE_S = 10.0


class Clocks:
    """The clocks of a machine that somebody sets, or starts anew."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.wall_s, self.steady_s = 1.8e9, 50_000.0
        told = SimpleNamespace(
            time_ns=lambda: int(self.wall_s * 1e9), monotonic_ns=lambda: int(self.steady_s * 1e9)
        )
        monkeypatch.setattr(clock, "time", told)

    def pass_s(self, seconds: float) -> None:
        self.wall_s += seconds
        self.steady_s += seconds


@pytest.fixture
def clocks(monkeypatch) -> Clocks:
    return Clocks(monkeypatch)


@pytest.fixture
def file_store(sqlite_url) -> Iterator[Store]:
    store = open_store(sqlite_url)
    yield store
    store.close()


@pytest.fixture(params=["memory", "sqlite"])
def local_store(request) -> Store:
    """A store whose leases are dated by the machine."""
    return (
        open_store("memory://")
        if request.param == "memory"
        else request.getfixturevalue("file_store")
    )


def free(store: Store) -> bool:
    return store.jobs.waiting(JobKind.CAMPAIGN) == 1


@pytest.mark.fault(
    "wall clock that jumps",
    group="time",
    outcome="The hub, the workers and the leases of jobs are not affected. Keys and sessions "
    "expire by the clock as it is set; lists keep their order, and a repeated request"
    " has no second effect.",
)
@pytest.mark.parametrize("jump_s", [-HOUR_S, HOUR_S])
def test_a_wall_clock_that_jumps_frees_no_living_job(store: Store, clocks: Clocks, jump_s) -> None:
    running(store)
    job = claimed(store, LONG_S)
    clocks.wall_s += jump_s
    assert not free(store)
    assert store.jobs.claim("another", LONG_S) is None
    assert store.jobs.renew(job, LONG_S)


@pytest.mark.fault("wall clock that jumps")
@pytest.mark.parametrize("jump_s", [-HOUR_S, HOUR_S])
def test_nor_does_it_block_a_lost_one(local_store: Store, clocks: Clocks, jump_s) -> None:
    running(local_store)
    job = claimed(local_store, LEASE_S)
    clocks.wall_s += jump_s
    clocks.pass_s(LEASE_S - 0.1)
    assert not free(local_store)
    clocks.pass_s(0.2)
    assert free(local_store)
    assert claimed(local_store).id == job.id


@pytest.mark.fault("wall clock that jumps")
@pytest.mark.parametrize("up_s", [1.0, 49_000.0])
def test_a_lease_of_before_the_machine_was_started_anew_is_over(
    file_store: Store, clocks: Clocks, up_s
) -> None:
    running(file_store)
    claimed(file_store, LEASE_S)
    clocks.steady_s = up_s
    assert free(file_store)
    claimed(file_store, LEASE_S)
    assert not free(file_store)


@pytest.mark.fault("wall clock that jumps")
def test_a_servers_clock_that_is_set_back_blocks_nothing(sql_store: Store) -> None:
    running(sql_store)
    job = claimed(sql_store, LEASE_S)
    later = jobs.c.lease_until_ms + 1_000 * HOUR_S
    with sql_store.database.writing() as connection:
        connection.execute(update(jobs).values(lease_until_ms=later))
    assert free(sql_store)
    assert sql_store.jobs.renew(job, LEASE_S)
    assert not free(sql_store)
