"""A service around which workers are played, and what an onlooker knows of it."""

from itertools import count
from types import SimpleNamespace

from benchmarks.faults.fake_services import FakeLearner, fake_hub
from inprocess import NoAnalyses
from service_workers import FakeWorker, Key

from eigenfail.errors import StoreUnavailable
from eigenfail.testing.examples import result
from eigenfail.values.campaign import FINAL_STATES, CampaignState
from eigenfail.wire.messages import Ack, Lease, Results, encode, read_hub_message
from eigenfail_api.routes.campaigns import RESUME, steer
from eigenfail_services.campaigns.supervisor import Supervisor
from eigenfail_services.hub.worker_sessions import ADOPTION_GRACE_S

EPISODES = 8
TURNS_TO_THE_END = 400
POOR_REASONS = ("failed 3 times in a row", "was lost 5 times in a row")


class House:
    """A service, the workers around it, and what an onlooker knows."""

    def __init__(self, store, learners: list[FakeLearner], now_s: list[float]) -> None:
        self.store, self.learners, self.now_s = store, learners, now_s
        self.workers: list[FakeWorker] = []
        self.names = count()
        self.campaigns: list[int] = []
        self.digests: dict[Key, str] = {}
        self.greeting = False
        self.open()

    def open(self) -> None:
        self.hub, self.router = fake_hub(self.store)
        self.supervisor = Supervisor(self.store, self.hub, NoAnalyses())

    def close(self) -> None:
        self.hub._close()
        self.deliver()
        self.supervisor.release()

    def be_killed(self) -> None:
        """Nobody is told, and what was not committed is lost; then the jobs are free."""
        self.supervisor.release()
        self.open()
        self.greeting = True
        self.seconds(int(ADOPTION_GRACE_S) - 1)
        self.greeting = False
        for worker in self.workers:
            assert not worker.heard or worker.connection in self.hub._leases.sessions

    def say(self, worker: FakeWorker, *messages) -> None:
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
                self.watch_lease(connection, (message.campaign, task.index))
        if isinstance(message, Ack) and message.campaign in self.campaigns:
            state = self.store.campaigns.get(message.campaign).state
            for index in message.indices:
                kept = self.store.episodes.finished(message.campaign, [index])
                assert kept or state in FINAL_STATES or not 0 <= index < EPISODES

    def watch_lease(self, connection: bytes, key: Key) -> None:
        """What a worker has is not leased to another one, unless the hub lost sight of it.

        A hub that has just begun sees nobody yet; all that are heard in time are to be spared.
        """
        for worker in self.workers:
            seen = worker.connection in self.hub._leases.sessions or (
                self.greeting and worker.heard
            )
            has_it = key in worker.held or key in worker.outbox
            assert worker.connection == connection or not seen or not has_it

    def seconds(self, seconds: int) -> None:
        """Time goes by; workers that are well are heard every second."""
        for _ in range(seconds):
            for worker in self.workers:
                if worker.heard:
                    self.say(worker, worker.beat())
            self.turn(1.0)

    def run_one(self, worker: FakeWorker) -> None:
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
            assert counts.completed + counts.errored == len(rows)
            ended = counts.completed + counts.errored + counts.cancelled
            assert counts.planned == EPISODES == ended + counts.open
            assert counts.open == 0 or found.state not in FINAL_STATES
            for row in rows:
                key = (campaign, row.index)
                assert self.digests.setdefault(key, row.digest) == row.digest

    def nobody_shares(self) -> None:
        """An episode lies with one worker at most."""
        held = [key for seat in self.hub._leases.sessions.values() for key in seat.held]
        assert len(held) == len(set(held))

    def miss_words(self, worker: FakeWorker) -> None:
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
            self.workers.append(FakeWorker(b"last", "last"))
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
                assert found.counts.completed + found.counts.errored == EPISODES


class Away:
    """A store whose parts can be away for a while."""

    def __init__(self, store) -> None:
        self._store = store
        self.away = False
        for part in ("campaigns", "checkpoints", "events", "jobs", "figures", "analyses", "roster"):
            setattr(self, part, getattr(store, part))
        self.episodes = SimpleNamespace(
            commit=self.commit,
            add_death=self.add_death,
            finished=store.episodes.finished,
            page=store.episodes.page,
        )

    def commit(self, campaign, deliveries, meanwhile):
        if self.away:
            raise StoreUnavailable("The disk is full.")
        return self._store.episodes.commit(campaign, deliveries, meanwhile)

    def add_death(self, campaign, index):
        if self.away:
            raise StoreUnavailable("The disk is full.")
        return self._store.episodes.add_death(campaign, index)
