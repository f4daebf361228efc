"""The lease table against a simple model: nothing lost, nothing held twice."""

from math import inf, nan

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from eigenfail.values import EpisodeTask, PriorSource
from eigenfail_services.hub.leases import MAX_LOSSES, Leases

WORKERS = st.sampled_from([b"a", b"b", b"c"])
CAMPAIGNS = st.sampled_from([1, 2])


def tasks(*indices: int) -> tuple[EpisodeTask, ...]:
    return tuple(EpisodeTask(index, index, PriorSource()) for index in indices)


class LeaseTable(RuleBasedStateMachine):
    """Any order of events; the model knows which episodes are open and who was given what."""

    def __init__(self) -> None:
        super().__init__()
        self.leases = Leases()
        self.open: set[tuple[int, int]] = set()
        self.given: dict[bytes, set[tuple[int, int]]] = {}
        self.next_index = 0

    @rule(worker=WORKERS, credit=st.integers(1, 40))
    def join(self, worker: bytes, credit: int) -> None:
        self.leases.leave(worker)
        self.leases.join(worker, worker.decode(), credit, 0.0)
        self.given[worker] = set()

    @rule(worker=WORKERS)
    def leave(self, worker: bytes) -> None:
        assert self.leases.leave(worker) == []
        self.given.pop(worker, None)

    @rule(campaign=CAMPAIGNS, n=st.integers(1, 30))
    def offer(self, campaign: int, n: int) -> None:
        indices = range(self.next_index, self.next_index + n)
        self.next_index += n
        self.leases.offer(campaign, tasks(*indices))
        self.open |= {(campaign, index) for index in indices}

    @rule(campaign=CAMPAIGNS)
    def withdraw(self, campaign: int) -> None:
        self.leases.withdraw(campaign)
        self.open = {key for key in self.open if key[0] != campaign}
        for held in self.given.values():
            held -= {key for key in held if key[0] == campaign}

    @rule(data=st.data(), wall_s=st.floats(0.001, 10.0))
    def settle(self, data: st.DataObject, wall_s: float) -> None:
        if self.open:
            key = data.draw(st.sampled_from(sorted(self.open)))
            self.leases.settle(*key, wall_s)
            self.open.discard(key)
            for held in self.given.values():
                held.discard(key)

    @rule()
    def assign(self) -> None:
        for assignment in self.leases.assign():
            for task in assignment.tasks:
                key = (assignment.campaign, task.index)
                assert key in self.open
                assert all(key not in held for held in self.given.values())
                self.given[assignment.worker].add(key)

    @invariant()
    def seats_hold_what_they_were_given(self) -> None:
        assert {w: set(seat.held) for w, seat in self.leases.seats.items()} == self.given

    @invariant()
    def nobody_holds_more_than_their_credit(self) -> None:
        assert all(len(seat.held) <= seat.credit for seat in self.leases.seats.values())

    def teardown(self) -> None:
        """Whatever is open is run in the end, once, by a worker that settles all it gets."""
        self.leases.join(b"last", "last", 1_000, 0.0)
        for worker in list(self.given):
            self.leases.leave(worker)
        while assignments := self.leases.assign():
            for assignment in assignments:
                for task in assignment.tasks:
                    self.open.remove((assignment.campaign, task.index))
                    self.leases.settle(assignment.campaign, task.index, 0.01)
        assert not self.open


LeaseTable.TestCase.settings = settings(max_examples=60, stateful_step_count=30, deadline=None)
TestLeaseTable = LeaseTable.TestCase


def seated(*workers: bytes) -> Leases:
    leases = Leases()
    for worker in workers:
        leases.join(worker, worker.decode(), 256, 0.0)
    return leases


def test_a_short_round_is_spread_over_all_workers() -> None:
    leases = seated(b"a", b"b")
    leases.offer(1, tasks(*range(10)))
    leases.assign()
    assert sorted(len(seat.held) for seat in leases.seats.values()) == [5, 5]


def test_slow_episodes_are_leased_in_small_batches() -> None:
    leases = seated(b"a")
    leases.offer(1, tasks(*range(1000)))
    leases.settle(1, 0, wall_s=1.0)
    leases.assign()
    assert len(leases.seats[b"a"].held) == 2


def test_episodes_of_a_lost_worker_come_first_and_in_order() -> None:
    leases = seated(b"a")
    leases.offer(1, tasks(*range(6)))
    first = [task.index for a in leases.assign() for task in a.tasks]
    leases.leave(b"a")
    leases.offer(1, tasks(6))
    leases.join(b"b", "b", 256, 0.0)
    again = [task.index for a in leases.assign() for task in a.tasks]
    assert again == [*first, 6]


def test_an_episode_that_takes_three_workers_with_it_is_given_up() -> None:
    leases = Leases()
    leases.offer(1, tasks(0, 1))
    for attempt in range(1, MAX_LOSSES + 1):
        leases.join(b"w", "w", 2, 0.0)
        leases.assign()
        leases.running(b"w", 1, 0)
        given_up = leases.leave(b"w")
        assert [(campaign, task.index) for campaign, task in given_up] == (
            [(1, 0)] if attempt == MAX_LOSSES else []
        )
    leases.join(b"w", "w", 2, 0.0)
    assert [task.index for a in leases.assign() for task in a.tasks] == [1]


def test_a_late_result_of_a_waiting_episode_saves_the_work() -> None:
    leases = seated(b"a")
    leases.offer(1, tasks(0))
    leases.assign()
    leases.leave(b"a")
    leases.settle(1, 0, 0.1)
    leases.join(b"b", "b", 256, 0.0)
    assert leases.assign() == []


def test_a_silent_worker_is_noticed_and_a_heard_one_is_not() -> None:
    leases = seated(b"a", b"b")
    leases.heard(b"b", 15.0)
    assert leases.silent(now_s=20.5, limit_s=20.0) == [b"a"]


def test_campaigns_share_the_workers() -> None:
    leases = seated(b"a")
    leases.offer(1, tasks(*range(100)))
    leases.offer(2, tasks(*range(100, 200)))
    leases.assign()
    held = [campaign for campaign, _ in leases.seats[b"a"].held]
    assert abs(held.count(1) - held.count(2)) <= len(held) // 2
    assert min(held.count(1), held.count(2)) >= 2


@pytest.mark.parametrize("wall_s", [nan, inf, -inf, -1.0, 0.0])
def test_a_time_that_is_none_changes_no_pace(wall_s: float) -> None:
    leases = seated(b"a")
    leases.offer(1, tasks(*range(1000)))
    leases.settle(1, 0, wall_s=1.0)
    leases.settle(1, 1, wall_s)
    leases.assign()
    assert len(leases.seats[b"a"].held) == 2
