"""Leases of several campaigns on workers that this test plays: who got how much of their time."""

import sys
from collections import Counter, deque
from heapq import heappop, heappush
from itertools import count
from typing import Self

import pytest

from eigenfail.values.episode import EpisodeTask, PriorSource
from eigenfail.wire.messages import PROTOCOL, Hello
from eigenfail_services.hub.leases import Leases

PRIOR = PriorSource()
MANY = 100_000


def tasks(n: int) -> tuple[EpisodeTask, ...]:
    return tuple(EpisodeTask(index, index, PRIOR) for index in range(n))


def seated(workers: int, credit: int = 256) -> Leases:
    leases = Leases()
    for n in range(workers):
        leases.open_session(b"%d" % n, Hello(PROTOCOL, f"w{n}", credit, life=f"l{n}"), 0.0)
    return leases


class Crew:
    """Workers that run what they hold one after the other, on a clock of their own."""

    def __init__(self, workers: int, takes_s: dict[int, float]) -> None:
        self.leases = seated(workers)
        self.takes_s = takes_s
        self.worked_s = Counter[int]()
        self.leased: list[int] = []
        self._queues: dict[bytes, deque[tuple[int, int]]] = {
            w: deque() for w in self.leases.sessions
        }
        self._ends: list[tuple[float, int, bytes]] = []
        self._numbers = count()
        self.now_s = 0.0

    def offer(self, campaign: int, episodes: int, weight: float = 1.0) -> None:
        self.leases.set_weight(campaign, weight)
        self.leases.offer(campaign, tasks(episodes))

    def work(self, until_s: float) -> None:
        self._hand_out()
        while self._ends and self._ends[0][0] <= until_s:
            self.now_s, _, worker = heappop(self._ends)
            campaign, index = self._queues[worker].popleft()
            self.worked_s[campaign] += self.takes_s[campaign]
            self.leases.record_result(campaign, index, self.takes_s[campaign])
            self.leases.record_verdict(campaign, index)
            self._begin(worker)
            self._hand_out()

    def _hand_out(self) -> None:
        for assignment in self.leases.assign():
            queue = self._queues[assignment.worker]
            was_idle = not queue
            queue.extend((assignment.campaign, task.index) for task in assignment.tasks)
            self.leased.extend(assignment.campaign for _ in assignment.tasks)
            if was_idle:
                self._begin(assignment.worker)

    def _begin(self, worker: bytes) -> None:
        if queue := self._queues[worker]:
            ends_s = self.now_s + self.takes_s[queue[0][0]]
            heappush(self._ends, (ends_s, next(self._numbers), worker))

    def share(self, campaign: int) -> float:
        return self.worked_s[campaign] / self.worked_s.total()


@pytest.mark.parametrize("workers", [1, 8])
@pytest.mark.parametrize("slow_s", [0.05, 0.5, 5.0])
def test_the_time_of_workers_is_shared_and_not_their_episodes(workers: int, slow_s: float) -> None:
    crew = Crew(workers, {1: 0.05, 2: slow_s})
    for campaign in (1, 2):
        crew.offer(campaign, MANY)
    crew.work(until_s=1_000.0)
    assert crew.share(1) == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("weights", [{1: 1, 2: 3}, {1: 1, 2: 3, 3: 9}, {1: 9, 2: 9, 3: 1}])
def test_the_shares_are_those_of_the_weights(weights: dict[int, int]) -> None:
    crew = Crew(4, {1: 0.04, 2: 0.2, 3: 0.1})
    for campaign, weight in weights.items():
        crew.offer(campaign, MANY, weight)
    crew.work(until_s=500.0)
    for campaign, weight in weights.items():
        assert crew.share(campaign) == pytest.approx(weight / sum(weights.values()), abs=0.03)


def test_no_worker_waits_while_there_is_work() -> None:
    crew = Crew(4, {1: 0.01, 2: 10.0})
    for campaign in (1, 2):
        crew.offer(campaign, MANY)
    crew.work(until_s=300.0)
    assert crew.worked_s.total() == pytest.approx(4 * 300.0, abs=4 * 10.0)


def test_ten_episodes_beside_a_hundred_thousand_are_soon_leased() -> None:
    crew = Crew(4, {1: 0.1, 2: 0.1})
    crew.offer(1, MANY)
    crew.work(until_s=60.0)
    before = len(crew.leased)
    crew.offer(2, 10)
    crew.work(until_s=70.0)
    after = crew.leased[before:]
    assert after.count(2) == 10
    last = max(place for place, campaign in enumerate(after) if campaign == 2)
    assert last < 40  # ten of its own, as many of the other one, and a portion or two


def test_a_worker_that_leaves_costs_its_campaigns_nothing() -> None:
    crew = Crew(8, {1: 0.1, 2: 0.1})
    crew.offer(1, MANY)
    crew.work(until_s=10.0)
    for _ in range(100):  # who comes, is given work of the first one, and goes
        crew.leases.open_session(b"x", Hello(PROTOCOL, "x", 256), 0.0)
        crew.leases.assign()
        crew.leases.end_session(b"x")
    crew.offer(2, MANY)
    crew.worked_s.clear()
    crew.work(until_s=500.0)
    assert crew.share(1) == pytest.approx(0.5, abs=0.03)


def test_a_lease_that_ends_unused_leaves_its_campaign_the_next_turn() -> None:
    leases = seated(0)
    for campaign in (1, 2):
        leases.offer(campaign, tasks(9))
    for worker in (b"a", b"b"):
        leases.open_session(worker, Hello(PROTOCOL, "x", 1), 0.0)
        assert [each.campaign for each in leases.assign()] == [1]
        leases.end_session(worker)


class Opcodes:
    """Counts what the interpreter does within the block."""

    def __enter__(self) -> Self:
        self.count = 0
        self._before = sys.gettrace()
        sys.settrace(self._trace)
        return self

    def __exit__(self, *_: object) -> None:
        sys.settrace(self._before)

    def _trace(self, frame, event, _argument):
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        self.count += event == "opcode"
        return self._trace


def effort(workers: int, act) -> float:
    """Opcodes for each of the episodes that go through a table of so many workers."""
    leases = seated(workers)
    leases.offer(1, tasks(40 * workers))
    leases.offer(2, tasks(40 * workers))
    for campaign in (1, 2):
        leases.complete(campaign, 0, wall_s=1.0)
    leases.assign()
    held = [(w, *seat.held) for w, seat in list(leases.sessions.items())[:20]]
    with Opcodes() as counted:
        act(leases, held)
    return counted.count / len(held)


def bring_one_and_lease_another(leases: Leases, held) -> None:
    for _, (campaign, index), *_ in held:
        leases.record_result(campaign, index, 1.0)
        leases.record_verdict(campaign, index)
        assert leases.assign()
        assert leases.has_leases(campaign)
        assert leases.lease_held_episodes(lambda *_: b"") == set()


def lose_and_join(leases: Leases, held) -> None:
    for worker, *_ in held:
        leases.end_lost_session(worker)
        leases.open_session(worker, Hello(PROTOCOL, "w", 256, life=f"new {worker!r}"), 0.0)
        assert leases.list_silent(1.0, 10.0) == []
        leases.touch(worker, 1.0)


@pytest.mark.parametrize("act", [bring_one_and_lease_another, lose_and_join])
def test_what_an_event_costs_does_not_grow_with_the_number_of_workers(act) -> None:
    few, many = effort(50, act), effort(5_000, act)
    assert many < 1.5 * few
