"""Whom a worker blames for the processes that it loses."""

import pytest

from eigenfail.errors import ServiceError
from eigenfail.values.episode import EpisodeTask, PriorSource
from eigenfail_workers.worker import inner_processes
from eigenfail_workers.worker.child_process import HeldEpisode


@pytest.fixture
def failures() -> inner_processes.ProcessFailures:
    return inner_processes.ProcessFailures()


def held(index: int) -> HeldEpisode:
    return HeldEpisode(1, EpisodeTask(index, 0, PriorSource()))


def test_an_episode_has_three_tries_and_others_have_their_own(failures) -> None:
    assert [failures.blame(held(0), 1) for _ in range(3)] == [False, False, True]
    assert not failures.blame(held(1), 1)


def test_a_result_wipes_the_slate(failures) -> None:
    for _ in range(2):
        failures.blame(held(0), 1)
    failures.record_result(1, 0)
    assert not failures.blame(held(0), 1)


def test_an_episode_that_never_begins_is_given_up_at_last(failures) -> None:
    for _ in range(inner_processes.MAX_FAILED_STARTS):
        failures.record_end(ready=True, status=-9)
        assert not failures.blame(held(0), 0)
    failures.record_end(ready=True, status=-9)
    assert failures.blame(held(0), 0)


def test_processes_that_never_get_ready_are_the_workers_own_trouble(failures) -> None:
    for _ in range(inner_processes.MAX_UNREADY_STARTS - 1):
        failures.record_end(ready=False, status=1)
    with pytest.raises(ServiceError, match=r"10 ended, one after the other.*exit status 1"):
        failures.record_end(ready=False, status=1)


def test_only_starts_in_a_row_count(failures) -> None:
    for _ in range(2):
        for _ in range(inner_processes.MAX_UNREADY_STARTS - 1):
            failures.record_end(ready=False, status=-9)
        failures.record_end(ready=True, status=-9)
    assert not failures.blame(held(0), inner_processes.MAX_CHILD_DEATHS - 1)
