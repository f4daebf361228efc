"""Whom a worker blames for the processes that it loses."""

import pytest

from eigenfail.errors import ServiceError
from eigenfail.values import EpisodeTask, PriorSource
from eigenfail_workers.worker.child_process import Held
from eigenfail_workers.worker.deaths import (
    MAX_CHILD_DEATHS,
    MAX_FALSE_STARTS,
    MAX_STILLBORN,
    Deaths,
)


@pytest.fixture
def deaths() -> Deaths:
    return Deaths()


def held(index: int) -> Held:
    return Held(1, EpisodeTask(index, 0, PriorSource()))


def test_an_episode_has_three_tries_and_others_have_their_own(deaths) -> None:
    assert [deaths.spent(held(0), 1) for _ in range(3)] == [False, False, True]
    assert not deaths.spent(held(1), 1)


def test_a_result_wipes_the_slate(deaths) -> None:
    for _ in range(2):
        deaths.spent(held(0), 1)
    deaths.brought(1, 0)
    assert not deaths.spent(held(0), 1)


def test_an_episode_that_never_begins_is_given_up_at_last(deaths) -> None:
    for _ in range(MAX_FALSE_STARTS):
        deaths.lost(ready=True, status=-9)
        assert not deaths.spent(held(0), 0)
    deaths.lost(ready=True, status=-9)
    assert deaths.spent(held(0), 0)


def test_processes_that_never_get_ready_are_the_workers_own_trouble(deaths) -> None:
    for _ in range(MAX_STILLBORN - 1):
        deaths.lost(ready=False, status=1)
    with pytest.raises(ServiceError, match=r"10 ended, one after the other.*exit status 1"):
        deaths.lost(ready=False, status=1)


def test_only_starts_in_a_row_count(deaths) -> None:
    for _ in range(2):
        for _ in range(MAX_STILLBORN - 1):
            deaths.lost(ready=False, status=-9)
        deaths.lost(ready=True, status=-9)
    assert not deaths.spent(held(0), MAX_CHILD_DEATHS - 1)
