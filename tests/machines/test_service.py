"""Users, supervisors, a hub and workers in any order of events: no episode is lost, none doubled.

Real: the store, the supervisor, the hub and all that it is made of. Played: learners, workers, the
socket between, and the clock.
"""

import shutil
import tempfile
from contextlib import ExitStack, closing
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)
from played import PlayedLearner, played_hub, played_learners, quiet

from eigenfail.errors import IllegalTransition, StoreUnavailable
from eigenfail.testing.store.examples import result
from eigenfail.values import FINAL_STATES, CampaignSpec, CampaignState, PolicySource
from eigenfail.wire.messages import (
    PROTOCOL,
    Ack,
    Drop,
    Goodbye,
    Heartbeat,
    Hello,
    Lease,
    PolicyUpdate,
    Refusal,
    Results,
    Setup,
    Welcome,
    encode,
    read_hub_message,
)
from eigenfail_api.steering import CANCEL, PAUSE, RESUME, steer
from eigenfail_services.campaigns import supervisor, watch
from eigenfail_services.campaigns.supervisor import Supervisor
from eigenfail_services.hub import commits, desk
from eigenfail_services.hub.desk import SILENCE_LIMIT_S
from eigenfail_services.store import MemoryStore, open_store

EPISODES = 8
CREDIT = 4
TURNS_TO_THE_END = 400
POOR_REASONS = ("died 3 times in a row", "was lost 5 times in a row")

Key = tuple[int, int]
numbers = st.integers(0, 50)


class NoAnalyses:
    """Nobody asks for one."""

    def __len__(self) -> int:
        return 0

    def open(self, job) -> None:
        raise AssertionError(job)

    def tend(self) -> None:
        pass


class PlayedWorker:
    """One connection: does what it is told, when it is told to; keeps results until the ack."""

    def __init__(self, connection: bytes, name: str) -> None:
        self.connection, self.name = connection, name
        self.heard = True
        self.welcome = self.missed = False
        self.words: list[object] = []
        self.held: dict[Key, object] = {}
        self.outbox: dict[Key, object] = {}
        self.setups: set[int] = set()
        self.policies: set[Key] = set()
        self.heeding = {
            Welcome: self.welcomed,
            Refusal: self.refused,
            Setup: lambda m: self.setups.add(m.campaign),
            PolicyUpdate: lambda m: self.policies.add((m.campaign, m.policy.version)),
            Lease: self.lease,
            Ack: self.ack,
            Drop: self.drop,
            Goodbye: self.refused,
        }

    def welcomed(self, _message) -> None:
        self.welcome, self.missed = True, False
        self.bring_again()

    def bring_again(self) -> None:
        for (campaign, _), done in self.outbox.items():
            self.words.append(Results(campaign, (done,)))

    def refused(self, _message) -> None:
        self.welcome = False

    def lease(self, message) -> None:
        for task in message.tasks:
            if not self.can_run(message.campaign, task.source):
                assert self.missed, "what it needs was not sent before it"
                self.welcome = False
            elif (message.campaign, task.index) in self.outbox:
                self.bring_again()
            else:
                self.held[message.campaign, task.index] = task

    def can_run(self, campaign: int, source) -> bool:
        by_policy = isinstance(source, PolicySource)
        known = not by_policy or (campaign, source.version) in self.policies
        return campaign in self.setups and known

    def ack(self, message) -> None:
        for index in message.indices:
            self.outbox.pop((message.campaign, index), None)

    def drop(self, message) -> None:
        self.setups.discard(message.campaign)
        self.policies = {key for key in self.policies if key[0] != message.campaign}
        self.held = {key: task for key, task in self.held.items() if key[0] != message.campaign}

    def beat(self) -> object:
        if not self.welcome:
            return Hello(PROTOCOL, self.name, CREDIT)
        return Heartbeat(*next(iter(self.held), (None, None)))


class House:
    """A service, the workers around it, and what an onlooker knows."""

    def __init__(self, store, learners: list[PlayedLearner], now_s: list[float]) -> None:
        self.store, self.learners, self.now_s = store, learners, now_s
        self.workers: list[PlayedWorker] = []
        self.names = count()
        self.campaigns: list[int] = []
        self.digests: dict[Key, str] = {}
        self.lent: dict[Key, bytes] = {}
        self.open()

    def open(self) -> None:
        self.hub, self.router = played_hub(self.store)
        self.supervisor = Supervisor(self.store, self.hub, NoAnalyses())

    def close(self) -> None:
        self.hub._close()
        self.deliver()
        self.supervisor.release()

    def say(self, worker: PlayedWorker, *messages) -> None:
        for message in messages:
            self.router.inbox.append([worker.connection, encode(message)])

    def turn(self, seconds: float = 0.1) -> None:
        self.now_s[0] += seconds
        self.supervisor.turn()
        self.hub.turn()
        self.deliver()

    def deliver(self) -> None:
        """Hand out what the hub has said."""
        by_connection = {worker.connection: worker for worker in self.workers}
        while self.router.outbox:
            connection, data = self.router.outbox.popleft()
            message = read_hub_message(data)
            self.watch(connection, message)
            if worker := by_connection.get(connection):
                worker.heeding[type(message)](message)
                self.say(worker, *worker.words)
                worker.words.clear()

    def watch(self, connection: bytes, message) -> None:
        """What is finished is not leased again; what is acknowledged is kept, or not wanted."""
        if isinstance(message, Lease):
            for task in message.tasks:
                assert not self.store.episodes.finished(message.campaign, [task.index])
        if isinstance(message, Ack) and message.campaign in self.campaigns:
            state = self.store.campaigns.get(message.campaign).state
            for index in message.indices:
                kept = self.store.episodes.finished(message.campaign, [index])
                assert kept or state in FINAL_STATES or not 0 <= index < EPISODES

    def seconds(self, seconds: int) -> None:
        """Time goes by; workers that are well are heard every second."""
        for _ in range(seconds):
            for worker in self.workers:
                if worker.heard:
                    self.say(worker, worker.beat())
            self.turn(1.0)

    def run_one(self, worker: PlayedWorker) -> None:
        if worker.held:
            key = next(iter(worker.held))
            task = worker.held.pop(key)
            done = result(key[1], seed=task.seed, source=task.source_kind)
            worker.outbox[key] = done
            self.say(worker, Results(key[0], (done,)))

    def account(self) -> None:
        """P1, and nothing that was kept is ever another."""
        for campaign in self.campaigns:
            found = self.store.campaigns.get(campaign)
            rows = self.store.episodes.page(campaign, 1_000).items
            counts = found.counts
            assert len({row.index for row in rows}) == len(rows)
            assert counts.completed + counts.failed == len(rows)
            ended = counts.completed + counts.failed + counts.cancelled
            assert counts.planned == EPISODES == ended + counts.open
            assert counts.open == 0 or found.state not in FINAL_STATES
            for row in rows:
                key = (campaign, row.index)
                assert self.digests.setdefault(key, row.digest) == row.digest

    def nobody_shares(self) -> None:
        """An episode lies with one worker at most."""
        held = [key for seat in self.hub._leases.seats.values() for key in seat.held]
        assert len(held) == len(set(held))

    def miss_words(self, worker: PlayedWorker) -> None:
        """It hands over what it holds, and what is said to it then goes astray."""
        while worker.held:
            self.run_one(worker)
        worker.missed = True
        worker.connection, connection = b"nobody", worker.connection
        self.turn()
        worker.connection = connection

    def end_well(self) -> None:
        """One last fault; then all workers are well, and whatever is to run runs to its end."""
        self.store.away = False
        for worker in self.workers:
            self.miss_words(worker)
            worker.heard = True
        if not self.workers:
            self.workers.append(PlayedWorker(b"last", "last"))
        turns = count()
        while not self.over():
            assert next(turns) < TURNS_TO_THE_END
            self.seconds(1)
            for worker in self.workers:
                while worker.held:
                    self.run_one(worker)
        self.judge()

    def over(self) -> bool:
        """Whether all campaigns have ended; those that rest are resumed."""
        states = [self.store.campaigns.get(campaign).state for campaign in self.campaigns]
        for campaign, state in zip(self.campaigns, states, strict=True):
            if state is CampaignState.PAUSED:
                steer(self.store, campaign, RESUME)
        return FINAL_STATES.issuperset(states)

    def judge(self) -> None:
        """What is done has run everything; what is dead says why."""
        self.account()
        for campaign in self.campaigns:
            found = self.store.campaigns.get(campaign)
            if found.state is CampaignState.DEAD:
                assert any(reason in found.stopped_because for reason in POOR_REASONS), found
            if found.state is CampaignState.DONE:
                assert found.counts.completed + found.counts.failed == EPISODES


class Away:
    """A store whose parts can be away for a while."""

    def __init__(self, store) -> None:
        self._store = store
        self.away = False
        for part in ("campaigns", "checkpoints", "events", "jobs", "figures", "analyses"):
            setattr(self, part, getattr(store, part))
        self.episodes = SimpleNamespace(
            commit=self.commit, finished=store.episodes.finished, page=store.episodes.page
        )

    def commit(self, campaign, deliveries):
        if self.away:
            raise StoreUnavailable("The disk is full.")
        return self._store.episodes.commit(campaign, deliveries)


class Service(RuleBasedStateMachine):
    """Anything may happen at any time."""

    def __init__(self, opened) -> None:
        super().__init__()
        self.stack = ExitStack()
        now_s = [1_000.0]
        clock = SimpleNamespace(monotonic=lambda: now_s[0])
        for module in (desk, commits, supervisor, watch):
            self.stack.enter_context(patch.object(module, "time", clock))
        self.stack.enter_context(quiet())
        learners = self.stack.enter_context(played_learners())
        self.house = House(Away(self.stack.enter_context(opened())), learners, now_s)

    def worker(self, number: int) -> PlayedWorker:
        return self.house.workers[number % len(self.house.workers)]

    def campaign(self, number: int) -> int:
        return self.house.campaigns[number % len(self.house.campaigns)]

    crewed = precondition(lambda self: self.house.workers)
    busy = precondition(lambda self: self.house.campaigns)

    @precondition(lambda self: len(self.house.campaigns) < 3)
    @rule()
    def create(self) -> None:
        spec = CampaignSpec(name="t", method="monte_carlo", episodes=EPISODES)
        self.house.campaigns.append(self.house.store.campaigns.create(spec).id)
        self.house.turn()

    @busy
    @rule(number=numbers, wish=st.sampled_from([PAUSE, RESUME, CANCEL]), turns=st.integers(0, 2))
    def steer(self, number, wish, turns) -> None:
        campaign = self.campaign(number)
        state = self.house.store.campaigns.get(campaign).state
        if state in wish.met or state in wish.steps:
            steer(self.house.store, campaign, wish)
        else:
            with pytest.raises(IllegalTransition, match=f"Campaign {campaign} .*{state}"):
                steer(self.house.store, campaign, wish)
        for _ in range(turns):
            self.house.turn()

    @precondition(lambda self: len(self.house.workers) < 4)
    @rule(name=st.sampled_from(["one", "one", "two"]))
    def join(self, name) -> None:
        worker = PlayedWorker(f"c{next(self.house.names)}".encode(), name)
        self.house.workers.append(worker)
        self.house.say(worker, worker.beat())
        self.house.turn()

    @crewed
    @rule(number=numbers, n=st.integers(1, 4))
    def work(self, number, n) -> None:
        for _ in range(n):
            self.house.run_one(self.worker(number))
        self.house.turn()

    @crewed
    @rule(number=numbers)
    def bring_again(self, number) -> None:
        self.worker(number).bring_again()
        self.house.turn()

    @busy
    @crewed
    @rule(number=numbers, index=st.integers(-1, EPISODES), salt=st.integers(0, 1))
    def bring_unasked(self, number, index, salt) -> None:
        """Before it was leased, after it was finished, of a campaign that is over."""
        campaign, worker = self.campaign(number), self.worker(number)
        done = result(index, salt=salt, seed=abs(index))
        self.house.say(worker, Results(campaign, (done,)), Results(999, (done,)))
        self.house.turn()

    @crewed
    @rule(number=numbers)
    def fall_silent(self, number) -> None:
        self.worker(number).heard = False

    @crewed
    @rule(number=numbers)
    def be_heard_again(self, number) -> None:
        worker = self.worker(number)
        worker.heard = True
        self.house.say(worker, worker.beat())
        self.house.turn()

    @crewed
    @rule(number=numbers)
    def miss_words(self, number) -> None:
        self.house.miss_words(self.worker(number))

    @crewed
    @rule(number=numbers)
    def hello_again(self, number) -> None:
        worker = self.worker(number)
        worker.welcome = False
        self.house.say(worker, worker.beat())
        self.house.turn()

    @crewed
    @rule(number=numbers, word=st.booleans())
    def die(self, number, word) -> None:
        worker = self.worker(number)
        if word:
            self.house.say(worker, Goodbye())
        self.house.workers.remove(worker)
        self.house.turn()

    @crewed
    @rule(number=numbers)
    def come_by_another_connection(self, number) -> None:
        """The network was away: the same process, with all that it holds."""
        worker = self.worker(number)
        worker.connection = f"c{next(self.house.names)}".encode()
        self.house.say(worker, worker.beat())
        self.house.turn()

    @rule(seconds=st.sampled_from([1, 3, int(SILENCE_LIMIT_S) + 2]))
    def wait(self, seconds) -> None:
        self.house.seconds(seconds)

    @rule(seconds=st.sampled_from([20, 3600]))
    def stand_still(self, seconds) -> None:
        self.house.turn(float(seconds))

    @rule(number=numbers)
    def lose_a_learner(self, number) -> None:
        if self.house.learners:
            self.house.learners[-1 - number % len(self.house.learners)].status = -9
        self.house.turn()

    @rule()
    def lose_the_store(self) -> None:
        self.house.store.away = not self.house.store.away
        self.house.turn(2.0)

    @rule()
    def begin_anew(self) -> None:
        """The service stops and starts again; workers find out by themselves."""
        self.house.close()
        self.house.open()
        self.house.turn()

    @invariant()
    def accounted(self) -> None:
        self.house.account()
        self.house.nobody_shares()

    def teardown(self) -> None:
        with self.stack:
            self.house.end_well()


def run(opened, examples: int) -> None:
    """Let the machine live many lives."""
    run_state_machine_as_test(
        lambda: Service(opened),
        settings=settings(
            max_examples=examples,
            stateful_step_count=40,
            deadline=None,
            derandomize=True,
            report_multiple_bugs=False,
            suppress_health_check=list(HealthCheck),
        ),
    )


def test_lives_in_memory() -> None:
    run(lambda: closing(MemoryStore()), 80)


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A database file with the schema and nothing else; copying it is quicker than migrating."""
    path = tmp_path_factory.mktemp("template") / "empty.db"
    open_store(f"sqlite:///{path}").close()
    return path


def test_lives_in_sqlite(template: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        numbers = count()

        def opened():
            path = Path(folder) / f"{next(numbers)}.db"
            shutil.copy(template, path)
            return closing(open_store(f"sqlite:///{path}"))

        run(opened, 8)
