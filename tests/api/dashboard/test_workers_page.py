"""The page of the workers: who is connected, and what each did lately."""

import pytest

from eigenfail.presentation.workers import WorkerState, combine_activity
from eigenfail.values.operations import Arrival, Presence, WorkerShare

VERSIONS = {"eigenfail": "0.1.0", "processor": "GenuineIntel 6 143"}


@pytest.fixture
def arrive(store):
    def come(name):
        arrival = Arrival(worker=name, host="rack 4", pid=7, versions=VERSIONS)
        store.roster.arrived([arrival])

    return come


def test_without_a_worker_it_says_how_to_start_one(check_page):
    check_page("dashboard/workers/empty", "/workers")


def test_connected_workers_and_those_that_left_are_listed(
    check_page, arrive, campaign, deliver, result
):
    arrive("<b>waiting</b>")
    deliver(campaign, result(0), result(1))
    check_page("dashboard/workers/listed", "/workers")


def test_latest_results_come_first():
    here = [
        Presence(id=n, worker=name, host="h", pid=n, versions=VERSIONS, arrived_ms=5, heard_ms=9)
        for n, name in enumerate(("a", "b"))
    ]
    shares = [
        WorkerShare(
            worker=name, campaign=1, episodes=2, failures=0, errored=0, wall_s=1.0, last_ms=last_ms
        )
        for name, last_ms in (("b", 10), ("c", 20))
    ]
    found = combine_activity(here, shares, shares[1:])
    assert [(each.worker, each.state) for each in found] == [
        ("c", WorkerState.GONE),
        ("b", WorkerState.WAITING),
        ("a", WorkerState.WAITING),
    ]
    assert (found[1].processor, found[1].heard_ms) == (VERSIONS["processor"], 9)
