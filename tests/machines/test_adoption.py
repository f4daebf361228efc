"""Deaths that workers live through: what they hold is run once, and the episodes stay the same.

Real: the store, the hub, the workers and all that they are made of. Played: learners, simulators,
the sockets between, and the clock.
"""

from collections import Counter, deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from types import SimpleNamespace
from typing import Any, ClassVar
from unittest.mock import patch

import pytest
from accepted import accept_spec
from benchmarks.faults import fake_worker
from benchmarks.faults.fake_services import FakeLearner, context_of, fake_hub, fake_learners, quiet
from benchmarks.faults.fake_worker import FakeEngine, FakeWorker
from sqlalchemy import select

from eigenfail.testing.examples import spec
from eigenfail.values.episode import EpisodeResult, EpisodeTask
from eigenfail_services.hub import commits, worker_sessions
from eigenfail_services.hub.commits import MAX_DEATHS
from eigenfail_services.hub.runs import RunSpec
from eigenfail_services.hub.worker_sessions import ADOPTION_GRACE_S, HEARTBEAT_S, SILENCE_LIMIT_S
from eigenfail_services.store.schema import deaths
from eigenfail_services.store.store import open_store
from eigenfail_workers.worker import child_process, parent
from eigenfail_workers.worker.parent import MAX_UNANSWERED

EPISODES = 18
STEP_S = 0.25
STEPS_TO_THE_END = 600
STEPS_OF_WORK = 3
"""Between two looks of a child at what it is to do: most of what is open is held, and not run."""

MOMENTS = range(1, 80, 5)
"""Steps after which something happens: before the first lease, and up to behind the last one."""


class CountingEngine(FakeEngine):
    """Knows how often each episode was run, by whomever."""

    runs: ClassVar = Counter[int]()

    def run(self, tasks: Sequence[EpisodeTask]) -> list[EpisodeResult]:
        self.runs.update(task.index for task in tasks)
        return super().run(tasks)


class House:
    """One campaign, a hub that runs it, and two workers that can be cut off from it."""

    def __init__(self, now_s: list[float], learners: list[FakeLearner]) -> None:
        self.now_s, self.learners = now_s, learners
        self._steps = 0
        self.cut: set[bytes] = set()
        self.held_up: list[tuple[deque[Any], Any]] = []
        self.store = open_store("memory://")
        self.campaign = self.store.campaigns.create(accept_spec(spec(episodes=EPISODES))).id
        self.workers = {b"a": FakeWorker(), b"b": FakeWorker()}
        self.open(launch_after=0)

    def open(self, launch_after: int) -> None:
        """A new hub, which is told of the campaign some steps later."""
        self.hub, self.router = fake_hub(self.store)
        self._launch_after = launch_after
        # Whoever came last comes first, so that nobody is leased the same again by chance.
        self.workers = dict(reversed(self.workers.items()))

    def step(self) -> None:
        """Everybody has one turn, and each worker's child does a little."""
        self.now_s[0] += STEP_S
        self._steps += 1
        if self._launch_after == 0:
            context = context_of(EPISODES)
            setup = spec(episodes=EPISODES).setup()
            self.hub.launch(RunSpec(self.campaign, setup, "monte_carlo", {}, 0, context))
        self._launch_after -= 1
        for connection, worker in self.workers.items():
            worker.turn()
            worker.work(messages=1 if self._steps % STEPS_OF_WORK == 0 else 0)
            while worker.dealer.outbox:
                said = [connection, worker.dealer.outbox.popleft()]
                self.carry(connection, self.router.inbox, said)
        self.hub.turn()
        while self.router.outbox:
            connection, data = self.router.outbox.popleft()
            if worker := self.workers.get(connection):
                self.carry(connection, worker.dealer.inbox, data)

    def carry(self, connection: bytes, inbox: deque[Any], message: Any) -> None:
        """To the other end of a line, unless it is cut."""
        if connection in self.cut:
            self.held_up.append((inbox, message))
        else:
            inbox.append(message)

    def end(self) -> str:
        """Go on until all is run; the digest of it."""
        for _ in range(STEPS_TO_THE_END):
            if self.store.campaigns.get(self.campaign).counts.open == 0:
                return self.store.episodes.digest(self.campaign)
            self.step()
        raise AssertionError("The campaign does not end.")


@pytest.fixture
def now_s() -> Iterator[list[float]]:
    """The clock of all of them."""
    now_s = [1_000.0]
    clock = SimpleNamespace(monotonic=lambda: now_s[0])
    with ExitStack() as stack:
        for module in (commits, worker_sessions, parent, child_process):
            stack.enter_context(patch.object(module, "time", clock))
        stack.enter_context(quiet())
        stack.enter_context(patch.object(fake_worker, "FakeEngine", CountingEngine))
        yield now_s


@pytest.fixture
def learners() -> Iterator[list[FakeLearner]]:
    with fake_learners() as learners:
        yield learners


@pytest.fixture
def house(now_s: list[float], learners: list[FakeLearner]) -> House:
    CountingEngine.runs.clear()
    return House(now_s, learners)


@pytest.fixture
def calm(now_s: list[float], learners: list[FakeLearner]) -> str:
    """The digest of the campaign if nothing happens."""
    return House(now_s, learners).end()


def each_once(house: House) -> bool:
    """And no worker that lives was taken for one that an episode has killed."""
    once = Counter(dict.fromkeys(range(EPISODES), 1))
    with house.store.database.reading() as connection:
        killers = connection.execute(select(deaths)).all()
    return CountingEngine.runs == once and not killers


def test_undisturbed_each_episode_is_run_once(house: House) -> None:
    house.end()
    assert each_once(house)


@pytest.mark.fault("SIGKILL of the services")
@pytest.mark.parametrize("launch_after", [0, 6, 40])
@pytest.mark.parametrize("moment", MOMENTS)
def test_a_service_that_is_killed_costs_no_episode(
    calm: str, house: House, moment: int, launch_after: int
) -> None:
    for _ in range(moment):
        house.step()
    house.open(launch_after)
    assert house.end() == calm
    assert each_once(house)


@pytest.mark.fault("SIGKILL of a learner")
@pytest.mark.parametrize("moment", MOMENTS)
def test_nor_does_a_learner(calm: str, house: House, moment: int) -> None:
    for _ in range(moment):
        house.step()
    house.learners[-1].status = -9
    assert house.end() == calm
    assert each_once(house)


@pytest.mark.fault("worker connection cut")
@pytest.mark.parametrize("moment", MOMENTS)
def test_nor_does_a_connection(calm: str, house: House, moment: int) -> None:
    for _ in range(moment):
        house.step()
    house.workers[b"c"] = house.workers.pop(b"a")
    assert house.end() == calm
    assert each_once(house)


def cut_for(house: House, seconds: float, *connections: bytes) -> None:
    """Nothing comes through these lines for so long, both ways; workers work on.

    What was said comes late, as TCP does it, unless the worker has made the line anew.
    """
    house.cut = {*connections}
    for _ in range(int(seconds / STEP_S)):
        house.step()
    house.cut, held_up, house.held_up = set(), house.held_up, []
    for inbox, message in held_up if seconds < MAX_UNANSWERED * HEARTBEAT_S else ():
        inbox.append(message)


@pytest.mark.fault("worker connection cut")
@pytest.mark.fault("worker connection unavailable")
@pytest.mark.parametrize("lines", [(b"a", b"b"), (b"a",)])
@pytest.mark.parametrize("seconds", [1.0, 10.0, 120.0])
@pytest.mark.parametrize("moment", MOMENTS[::4])
def test_nor_do_lines_that_are_cut(calm: str, house: House, moment: int, seconds, lines) -> None:
    for _ in range(moment):
        house.step()
    cut_for(house, seconds, *lines)
    assert house.end() == calm
    counts = house.store.campaigns.get(house.campaign).counts
    assert (counts.completed, counts.errored) == (EPISODES, 0)
    assert counts.duplicates <= CountingEngine.runs.total() - EPISODES
    assert lines == (b"a",) or max(CountingEngine.runs.values()) == 1


def test_all_of_it_again_and_again(calm: str, house: House) -> None:
    for moment in (5, 3, 8, 2, 6):
        for _ in range(moment):
            house.step()
        house.open(launch_after=moment)
        for _ in range(int(ADOPTION_GRACE_S / STEP_S) + moment):
            house.step()
        house.learners[-1].status = -9
    assert house.end() == calm
    assert each_once(house)


@pytest.mark.fault("SIGKILL of a worker")
def test_what_a_worker_held_as_it_died_is_run_by_the_others(calm: str, house: House) -> None:
    for _ in range(10):
        house.step()
    house.open(launch_after=0)
    for _ in range(int(ADOPTION_GRACE_S / STEP_S)):
        house.step()
    assert any(seat.held for seat in house.hub._leases.sessions.values())
    del house.workers[b"a"]
    for _ in range(int(SILENCE_LIMIT_S / STEP_S)):
        house.step()
    assert house.end() == calm


@pytest.mark.fault("episode that kills its worker")
def test_an_episode_that_takes_three_workers_with_it_is_given_up_whoever_counts(
    house: House,
) -> None:
    others, house.workers = house.workers, {}
    for number in range(MAX_DEATHS):
        worker = FakeWorker()
        worker.work = lambda messages: None  # type: ignore[method-assign]
        house.workers = {f"w{number}".encode(): worker}
        while (house.campaign, 0) not in {s.running for s in house.hub._leases.sessions.values()}:
            house.step()
        house.workers.clear()
        for _ in range(int(2 * SILENCE_LIMIT_S / STEP_S)):
            house.step()
        house.open(launch_after=0)
    house.workers = others
    house.end()
    counts = house.store.campaigns.get(house.campaign).counts
    assert (counts.completed, counts.errored) == (EPISODES - 1, 1)
    fault = house.store.episodes.get(house.campaign, 0).fault
    assert fault is not None
    assert fault.kind == "infrastructure"
