"""Once faults stop, a campaign ends in time: a lease, back-off, and a fifth more than undisturbed.

Real: the hub and all that it is made of, the supervisor, the store, the workers' outer processes.
Played: learners, inner processes, the network between, and the clock. A life takes no time, and a
seed is the same life again.
"""

from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from heapq import heappop, heappush
from itertools import count
from random import Random
from types import SimpleNamespace
from unittest.mock import patch

import pytest
from accepted import accept_spec
from benchmarks.faults.fake_services import FakeLearner, fake_hub, fake_learners, quiet
from benchmarks.faults.fake_worker import FakeWorker
from inprocess import NoAnalyses

from eigenfail.values.campaign import FINAL_STATES, CampaignState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail_services.campaigns import supervisor
from eigenfail_services.campaigns.supervisor import LEASE_S, Supervisor
from eigenfail_services.hub import commits, worker_sessions
from eigenfail_services.hub.worker_sessions import ADOPTION_GRACE_S, HEARTBEAT_S, SILENCE_LIMIT_S
from eigenfail_services.hub.worker_table import MAX_UNNAMED_HEARTBEATS
from eigenfail_services.store import clock
from eigenfail_services.store.store import Store, open_store
from eigenfail_workers.worker import child_process, parent
from eigenfail_workers.worker.parent import HELLO_EVERY_S

# Each life has all 14 faults, in another order: 210 in all.
LIVES = 15
WORKERS = 3
EPISODES = 180
EPISODE_S = 0.5
TURN_S = 0.1
TRIP_S = 0.02
SHARE = 0.1
"""Of messages that are lost, doubled, late, while the network is bad."""

LATE_S = 3.0
PAUSE_S = (0.5, 4.0)
"""Between two faults."""

HALT_S = (1.0, 25.0)
AWAY_S = 3.0
FAULTS = ("cut",) * 3 + ("halt", "worker", "child", "learner", "wall") * 2 + ("service",)
"""Of one life, in any order: too few for an episode or a learner to be given up."""

A_LEASE_S = max(SILENCE_LIMIT_S, LEASE_S, MAX_UNNAMED_HEARTBEATS * HEARTBEAT_S)
BACK_OFF_S = HELLO_EVERY_S + HEARTBEAT_S + commits.RETRY_S + ADOPTION_GRACE_S
MORE = 1.2
NEVER_S = 900.0


class Worker:
    """A worker's outer process, and the connection that it has now."""

    def __init__(self, name: int) -> None:
        self.name = name
        self.connections = count()
        self.process = FakeWorker()
        self.halted_until_s = self.worked_s = 0.0
        self.cut()

    def cut(self) -> None:
        self.connection = f"{self.name}/{next(self.connections)}".encode()

    def turn(self, now_s: float) -> None:
        """One of its loop; its inner process does one thing in the time of an episode."""
        if now_s < self.halted_until_s:
            return
        self.process.turn()
        if now_s - self.worked_s >= EPISODE_S:
            self.worked_s = now_s
            self.process.work(1)


class World:
    """A service, workers, a network, and a campaign."""

    def __init__(self, store: Store, learners: list[FakeLearner], random: Random) -> None:
        self.now_s = 1_000.0
        self.wall_s = 1.8e9
        self._store, self._learners, self._random = store, learners, random
        self._bad = False
        self._due: list[tuple[float, int, object, object]] = []
        self._numbers, self._names = count(), count()
        self._away_until_s = 0.0
        self._blows = {
            "cut": lambda: self._anyone().cut(),
            "halt": self._halt,
            "worker": self._kill_worker,
            "child": self._kill_child,
            "learner": self._kill_learner,
            "service": self._kill_service,
            "wall": self._set_wall,
        }

    def begin(self) -> None:
        """The clock is ours from here on."""
        self._open()
        self._workers = [Worker(next(self._names)) for _ in range(WORKERS)]
        spec = CampaignSpec(name="t", method="monte_carlo", episodes=EPISODES)
        self._campaign = self._store.campaigns.create(accept_spec(spec)).id

    def storm(self) -> None:
        """Every fault once, while messages are lost, doubled and late."""
        self._pass(AWAY_S)
        self._bad = True
        for fault in self._random.sample(FAULTS, len(FAULTS)):
            self._blows[fault]()
            self._pass(self._random.uniform(*PAUSE_S))
        self._bad = False
        self._away_until_s = 0.0
        for worker in self._workers:
            worker.halted_until_s = 0.0

    def end(self) -> float:
        """How long the campaign takes from now on. [s]"""
        from_s = self.now_s
        while self._is_running():
            self._pass(TURN_S)
            assert self.now_s - from_s < NEVER_S, "it never ends"
        return self.now_s - from_s

    def digest(self) -> str:
        """Of a campaign that is done."""
        ended = self._store.campaigns.get(self._campaign)
        assert ended.state is CampaignState.DONE, ended.stopped_because
        assert (ended.counts.completed, ended.counts.errored) == (EPISODES, 0)
        return self._store.episodes.digest(self._campaign)

    def _is_running(self) -> bool:
        return self._store.campaigns.get(self._campaign).state not in FINAL_STATES

    def _pass(self, seconds: float) -> None:
        until_s = self.now_s + seconds
        while self.now_s < until_s:
            self.now_s += TURN_S
            self._deliver()
            if self.now_s >= self._away_until_s:
                self._serve()
            for worker in self._workers:
                worker.turn(self.now_s)
                said = worker.process.dealer.outbox
                while said:
                    self._send(self._router.inbox, [worker.connection, said.popleft()])

    def _serve(self) -> None:
        self._supervisor.turn()
        self._hub.turn()
        inboxes = {each.connection: each.process.dealer.inbox for each in self._workers}
        while self._router.outbox:
            connection, data = self._router.outbox.popleft()
            if connection in inboxes:
                self._send(inboxes[connection], data)

    def _send(self, inbox: object, message: object) -> None:
        lost, doubled, late = (self._bad and self._random.random() < SHARE for _ in range(3))
        for _ in range(0 if lost else 1 + doubled):
            trip_s = self._random.uniform(0.0, LATE_S) if late else TRIP_S
            heappush(self._due, (self.now_s + trip_s, next(self._numbers), inbox, message))

    def _deliver(self) -> None:
        while self._due and self._due[0][0] <= self.now_s:
            *_, inbox, message = heappop(self._due)
            inbox.append(message)

    def _anyone(self) -> Worker:
        return self._random.choice(self._workers)

    def _halt(self) -> None:
        self._anyone().halted_until_s = self.now_s + self._random.uniform(*HALT_S)

    def _kill_worker(self) -> None:
        """Another one is started in its place; nobody hears of the first one any more."""
        place = self._random.randrange(WORKERS)
        self._workers[place] = Worker(next(self._names))

    def _kill_child(self) -> None:
        self._anyone().process.child.alive = False

    def _kill_learner(self) -> None:
        self._learners[-1].status = -9

    def _kill_service(self) -> None:
        """Another one starts a little later; nobody gave back what the first one had claimed."""
        self._open()
        self._away_until_s = self.now_s + AWAY_S

    def _set_wall(self) -> None:
        self.wall_s += self._random.choice((-3_600.0, 3_600.0))

    def _open(self) -> None:
        self._hub, self._router = fake_hub(self._store)
        self._supervisor = Supervisor(self._store, self._hub, NoAnalyses())


@contextmanager
def world(seed: int) -> Iterator[World]:
    """One that begins."""
    with ExitStack() as stack:
        learners = stack.enter_context(fake_learners())
        made = World(stack.enter_context(closing(open_store("memory://"))), learners, Random(seed))
        told = SimpleNamespace(
            monotonic=lambda: made.now_s,
            monotonic_ns=lambda: int(made.now_s * 1e9),
            time_ns=lambda: int((made.wall_s + made.now_s) * 1e9),
        )
        for module in (
            worker_sessions,
            commits,
            supervisor,
            clock,
            parent,
            child_process,
        ):
            stack.enter_context(patch.object(module, "time", told))
        stack.enter_context(quiet())
        made.begin()
        yield made


@pytest.fixture(scope="module")
def undisturbed() -> tuple[float, str]:
    """How long the campaign takes on a calm day, and its digest."""
    with world(0) as calm:
        return calm.end(), calm.digest()


@pytest.mark.fault("wall clock that jumps")
@pytest.mark.fault("messages lost, duplicated, delayed or reordered")
def test_once_faults_stop_a_campaign_ends_in_time(undisturbed: tuple[float, str]) -> None:
    undisturbed_s, digest = undisturbed
    for seed in range(LIVES):
        with world(seed) as life:
            life.storm()
            assert life.end() <= A_LEASE_S + BACK_OFF_S + MORE * undisturbed_s, seed
            assert life.digest() == digest, seed
