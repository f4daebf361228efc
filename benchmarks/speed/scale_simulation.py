"""A service with many workers, simulated event by event: pure."""

from collections import deque
from collections.abc import Callable
from heapq import heappop, heappush
from statistics import linear_regression

from benchmarks.speed.scale_parts import GROUP, GROUP_S, TURN, Costs, Method, WorkerPool


class Play:
    """One course of events.

    Attributes:
        rate: episodes per second, without those of the first third of the rounds: the slope of
            the line through the times at which rounds were learnt from (least squares). Where all
            workers end at the same time, rounds end in bursts, and rounds ÷ time would depend on
            how many of the bursts lie within it.
        hub_share: how much of that time the hub's thread worked.
    """

    def __init__(
        self, method: Method, pool: WorkerPool, costs: Costs, draw: Callable[[], float]
    ) -> None:
        self.rate = self.hub_share = 0.0
        self._method, self._costs, self._draw = method, costs, draw
        # Heartbeats take their part of the hub's time, all the time.
        self._slow = 1.0 / max(1e-9, 1.0 - pool.workers * costs.heartbeat_s)
        self._now_s, self._number = 0.0, 0
        self._events: list[tuple[float, int, Callable[[int], None], int]] = []
        self._idle, self._waiting = pool.workers, deque[int]()
        self._missing: dict[int, int] = {}
        self._proposed = self._learnt = 0
        self._learnt_s = list[float]()
        self._is_learning, self._proposals = False, 1
        self._is_hub_busy, self._hub_worked_s = False, 0.0
        self._inbox, self._group, self._due_s = deque[int](), list[int](), 0.0

    def run(self, rounds: int) -> None:
        """Until so many rounds were learnt from."""
        skipped = rounds // 3
        mark = (0.0, 0.0)
        self._serve()
        while self._learnt < rounds:
            if self._learnt <= skipped:
                mark = (self._now_s, self._hub_worked_s)
            self._now_s, _, happen, what = heappop(self._events)
            happen(what)
        took_s = self._now_s - mark[0]
        times_s = self._learnt_s[skipped:]
        rounds_per_s = linear_regression(times_s, range(len(times_s))).slope
        self.rate = rounds_per_s * self._method.round_size
        self.hub_share = min(1.0, (self._hub_worked_s - mark[1]) / took_s)

    def _after(self, seconds: float, happen: Callable[[int], None], what: int = 0) -> None:
        self._number += 1
        heappush(self._events, (self._now_s + seconds, self._number, happen, what))

    def _serve(self, _number: int = 0) -> None:
        """The hub's one thread turns to what is next, if it is free."""
        if self._is_hub_busy:
            return
        is_due = bool(self._group) and self._now_s >= self._due_s
        if is_due or len(self._group) >= GROUP:
            self._work(self._costs.commit_s, self._committed)
        elif self._proposals:
            self._work(self._method.checkpoint_s, self._kept)
        elif self._inbox:
            count = min(len(self._inbox), TURN)
            self._work(count * self._costs.result_s, self._taken, count)

    def _work(self, seconds: float, done: Callable[[int], None], what: int = 0) -> None:
        self._is_hub_busy = True
        self._hub_worked_s += seconds * self._slow
        self._after(seconds * self._slow, done, what)

    def _kept(self, _number: int) -> None:
        """Hand out the rounds that were proposed; each proposal has its own checkpoint."""
        self._is_hub_busy = False
        self._proposals -= 1
        while len(self._missing) <= self._method.lookahead:
            self._missing[self._proposed] = self._method.round_size
            self._waiting.extend([self._proposed] * self._method.round_size)
            self._proposed += 1
        self._begin()
        self._serve()

    def _begin(self) -> None:
        while self._idle and self._waiting:
            self._idle -= 1
            self._after(self._draw(), self._finished, self._waiting.popleft())

    def _finished(self, number: int) -> None:
        self._idle += 1
        self._begin()
        self._inbox.append(number)
        self._serve()

    def _taken(self, count: int) -> None:
        self._is_hub_busy = False
        if not self._group:
            self._due_s = self._now_s + GROUP_S
            self._after(GROUP_S, self._serve)
        self._group.extend(self._inbox.popleft() for _ in range(count))
        self._serve()

    def _committed(self, _number: int) -> None:
        self._is_hub_busy = False
        for number in self._group:
            self._missing[number] -= 1
        self._group = []
        self._learn()
        self._serve()

    def _learn(self) -> None:
        oldest = min(self._missing, default=None)
        if oldest is not None and not (self._is_learning or self._missing[oldest]):
            self._is_learning = True
            self._after(self._method.round_s, self._through, oldest)

    def _through(self, number: int) -> None:
        self._is_learning = False
        self._proposals += 1
        self._learnt += 1
        self._learnt_s.append(self._now_s)
        del self._missing[number]
        self._learn()
        self._serve()
