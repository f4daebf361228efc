"""Whom Ray is to have: taken on with the work, struck out when nothing of them is needed."""

from eigenfail.hosting.service import Span
from eigenfail_services.campaigns.launcher import WorkerNames
from eigenfail_services.hub.metrics import Work, WorkerDemand

IDLE_S = 20.0
NOTHING = Work()
MUCH = Work(episodes=100, worker_s=100.0)


def turns(roll: WorkerNames, begin_s, seconds, work=NOTHING, *, present=(), idle=()) -> None:
    for turn in range(int(4 * seconds) + 1):
        roll.look(begin_s + turn / 4, WorkerDemand(work, frozenset(present), frozenset(idle)))


def test_names_are_new_ones_however_often_somebody_goes() -> None:
    roll = WorkerNames(Span(0, 3, IDLE_S))
    turns(roll, 0.0, 3.0, MUCH)
    first = roll.names
    assert len(set(first)) == 3
    turns(roll, 4.0, IDLE_S, present=first, idle=first)
    assert roll.names == []
    turns(roll, 30.0, 3.0, MUCH)
    assert len(roll.names) == 3
    assert not set(first) & set(roll.names)


def test_who_holds_something_stays_until_it_does_not() -> None:
    roll = WorkerNames(Span(0, 3, IDLE_S))
    turns(roll, 0.0, 3.0, MUCH)
    busy = roll.names[2]
    turns(roll, 4.0, 2 * IDLE_S, present=roll.names, idle=set(roll.names) - {busy})
    assert roll.names == [busy]
    turns(roll, 50.0, 1.0, present=[busy], idle=[busy])
    assert roll.names == []


def test_workers_that_were_started_by_hand_count_and_are_left_alone() -> None:
    roll = WorkerNames(Span(0, 8, IDLE_S))
    turns(roll, 0.0, 3.0, Work(100, 10.0), present=["by-hand", "another"])
    assert len(roll.names) == 3


def test_a_fixed_number_is_asked_for_at_once_and_stays() -> None:
    roll = WorkerNames(Span(2, 2))
    before = roll.names
    turns(roll, 0.0, 100.0, present=before, idle=before)
    turns(roll, 101.0, 100.0, MUCH)
    assert roll.names == before
    assert len(before) == 2
