"""One worker is ten times slower than the others: it holds up the end by what it runs, no more.

Workers are played, on a clock of their own; the table of leases is real.
"""

from collections import Counter, deque
from heapq import heappop, heappush
from itertools import count
from random import Random

import pytest

from eigenfail.values.episode import EpisodeTask, PriorSource
from eigenfail.wire.messages import PROTOCOL, Hello
from eigenfail_services.hub.leases import Leases
from eigenfail_services.hub.worker_table import WORK_AHEAD_S

FAST = (b"f0", b"f1", b"f2")
SLOW = b"slow"
SLOWER = 10.0
CREDIT = 256
EPISODES = 3_000
UNPROVEN = 20
"""Episodes, while nobody knows how long one takes."""

SPREAD = (0.5, 1.5)
"""How much shorter or longer than others an episode may be."""


class Crew:
    """Three workers and a slow one, each of which runs what it holds one after the other."""

    def __init__(self, takes_s: float, seed: int) -> None:
        random = Random(seed)
        self._lengths_s = [takes_s * random.uniform(*SPREAD) for _ in range(EPISODES)]
        self._leases = Leases()
        self.queues: dict[bytes, deque[int]] = {}
        self._due: list[tuple[float, int, bytes]] = []
        self._numbers = count()
        self.now_s = 0.0
        self.leased = Counter[int]()
        self.ended_s: dict[bytes, float] = {}
        for worker in (*FAST, SLOW):
            self.queues[worker] = deque()
            hello = Hello(PROTOCOL, worker.decode(), CREDIT, life=worker.decode())
            self._leases.open_session(worker, hello, 0.0)

    def begin(self) -> None:
        """A campaign: everybody is leased something."""
        tasks = tuple(EpisodeTask(index, index, PriorSource()) for index in range(EPISODES))
        self._leases.offer(1, tasks)
        self._hand_out()

    def run(self) -> None:
        """To its end."""
        while self._due:
            self.now_s, _, worker = heappop(self._due)
            index = self.queues[worker].popleft()
            self._leases.record_result(1, index, self._length_s(worker, index))
            self._leases.record_verdict(1, index)
            self.ended_s[worker] = self.now_s
            self._begin(worker)
            self._hand_out()

    def _length_s(self, worker: bytes, index: int) -> float:
        return self._lengths_s[index] * (SLOWER if worker == SLOW else 1.0)

    def _hand_out(self) -> None:
        for assignment in self._leases.assign():
            queue = self.queues[assignment.worker]
            was_idle = not queue
            queue.extend(task.index for task in assignment.tasks)
            self.leased.update(task.index for task in assignment.tasks)
            if was_idle:
                self._begin(assignment.worker)

    def _begin(self, worker: bytes) -> None:
        if queue := self.queues[worker]:
            ends_s = self.now_s + self._length_s(worker, queue[0])
            heappush(self._due, (ends_s, next(self._numbers), worker))


@pytest.mark.fault(
    "worker ten times slower than the others",
    group="time",
    outcome="It holds about two seconds of work at its own pace, so it delays the end by the "
    "episode that it runs and one more. Before its first result it is leased 20 "
    "episodes at most.",
)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("takes_s", [0.01, 0.1, 1.0, 5.0])
def test_a_slow_worker_holds_up_the_end_by_what_it_runs_and_one_more(
    takes_s: float, seed: int
) -> None:
    crew = Crew(takes_s, seed)
    crew.begin()
    crew.run()
    longest_s = SLOWER * takes_s * SPREAD[1]
    others_s = max(crew.ended_s[worker] for worker in FAST)
    assert set(crew.leased) == set(range(EPISODES))
    assert set(crew.leased.values()) == {1}
    assert crew.ended_s[SLOW] - others_s <= max(2 * longest_s, WORK_AHEAD_S + longest_s)


@pytest.mark.fault("worker ten times slower than the others")
def test_before_its_first_result_it_is_leased_as_much_as_any_other() -> None:
    crew = Crew(1.0, seed=0)
    crew.begin()
    assert {len(queue) for queue in crew.queues.values()} == {UNPROVEN}


def test_a_late_result_is_that_of_who_brings_it() -> None:
    leases, others = Leases(), tuple(EpisodeTask(n, n, PriorSource()) for n in range(2))
    leases.open_session(b"late", Hello(PROTOCOL, "late", 1), 0.0)
    leases.offer(1, others[:1])
    leases.assign()
    leases.end_session(b"late")
    leases.open_session(b"now", Hello(PROTOCOL, "now", 1), 0.0)
    leases.assign()
    seat = leases.sessions[b"now"]
    assert set(seat.held) == {(1, 0)}
    leases.complete(1, 1, wall_s=1.0)
    leases.record_result(1, 0, 100.0, b"late")
    assert (seat.slowness, seat.held, seat.load_s) == (1.0, {}, 0.0)
    assert leases.episode_s(1) > 1.0
    assert leases._scheduler._pools[False].shares._clocks_s[1] == pytest.approx(0.0)
