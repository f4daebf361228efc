"""Two services on one database: one runs a campaign, and who was held up overwrites nothing.

Real: the store, supervisors, hubs and all that they are made of. Played: learners, workers, the
sockets between, and the clocks, that of the leases too.
"""

import random
import time
from collections.abc import Iterator
from contextlib import ExitStack
from functools import partial
from types import SimpleNamespace
from unittest.mock import patch

import pytest
from accepted import accept_spec
from benchmarks.faults.fake_services import fake_hub, fake_learners
from inprocess import NoAnalyses
from structlog.testing import capture_logs

from eigenfail.testing.examples import result
from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import episode_seed
from eigenfail.wire import messages
from eigenfail_services.campaigns import supervisor
from eigenfail_services.campaigns.supervisor import LEASE_S, Supervisor
from eigenfail_services.hub import commits, worker_sessions
from eigenfail_services.hub.server import FinishedRun
from eigenfail_services.store import clock
from eigenfail_services.store.store import Store, open_store

EPISODES = 20
SPEC = CampaignSpec(name="t", method="monte_carlo", episodes=EPISODES)
ROUND = 3
TURNS = 500


class Service:
    """A service with a worker of its own, which takes what it is given and runs it when told to."""

    def __init__(self, store: Store, now_s: list[float]) -> None:
        self.store, self.now_s = store, now_s
        self.hub, self.router = fake_hub(store)
        self.supervisor = Supervisor(store, self.hub, NoAnalyses())
        self.held: dict[tuple[int, int], object] = {}
        self.say(messages.Hello(messages.PROTOCOL, "w", EPISODES))

    def say(self, message) -> None:
        self.router.inbox.append([b"w", messages.encode(message)])

    def turn(self, seconds: float = 0.5) -> None:
        self.now_s[0] += seconds
        self.say(messages.Heartbeat(held=tuple(self.held)))
        self.supervisor.turn()
        self.turn_hub()

    def turn_hub(self) -> None:
        """Its supervisor is still held up."""
        self.hub.turn()
        while self.router.outbox:
            message = messages.read_hub_message(self.router.outbox.popleft()[1])
            if isinstance(message, messages.Lease):
                self.held |= {(message.campaign, task.index): task for task in message.tasks}
            if isinstance(message, messages.Drop):
                self.held.clear()
            if isinstance(message, messages.Goodbye):
                self.say(messages.Hello(messages.PROTOCOL, "w", EPISODES))

    def work(self, episodes: int = EPISODES) -> None:
        """Some of what lies here is run, and brought."""
        for campaign, index in list(self.held)[:episodes]:
            task = self.held.pop((campaign, index))
            done = result(index, seed=task.seed, source=task.source_kind)
            self.say(messages.Results(campaign, (done,)))

    def run_until(self, campaign: int, done: int) -> None:
        """Until the learner has seen so many episodes, and its checkpoint says so."""
        for _ in range(TURNS):
            if progress(self.store, campaign) >= done:
                return
            self.turn()
            self.work()
        raise AssertionError("The campaign does not get on.")

    def runs(self, campaign: int) -> bool:
        return campaign in self.hub._runs


def progress(store: Store, campaign: int) -> int:
    """How many episodes the learner of the checkpoint has seen."""
    return int(store.checkpoints.load(campaign) or b"0")


class Pair:
    """Two services, and a campaign."""

    def __init__(self, stores: list[Store], now_s: list[float]) -> None:
        self.store, self.now_s = stores[0], now_s
        self.services = [Service(store, now_s) for store in stores]
        self.campaign = self.store.campaigns.create(accept_spec(SPEC)).id

    @property
    def progress(self) -> int:
        return progress(self.store, self.campaign)

    def taken_over(self) -> tuple[Service, Service]:
        """One was held up as its learner had news for it; the other one went on from there."""
        old, new = self.services
        old.run_until(self.campaign, ROUND)
        while not old.hub._runs[self.campaign]._link.words:
            old.turn(0.1)
            old.work()
        self.now_s[0] += LEASE_S + 1.0
        new.run_until(self.campaign, self.progress + 2 * ROUND)
        assert old.runs(self.campaign)
        assert new.runs(self.campaign)
        return old, new

    def end(self, *services: Service) -> None:
        """All is well from now on."""
        for _ in range(TURNS):
            if self.store.campaigns.get(self.campaign).state is CampaignState.DONE:
                break
            for service in services:
                service.turn()
                service.work()
        ended = self.store.campaigns.get(self.campaign)
        assert ended.state is CampaignState.DONE, ended
        assert (ended.counts.completed, ended.counts.open) == (EPISODES, 0)
        assert ended.digest == self.undisturbed()

    def undisturbed(self) -> str:
        store = open_store("memory://")
        pair = Pair([store], self.now_s)
        alone = pair.services[0]
        while store.campaigns.get(pair.campaign).state is not CampaignState.DONE:
            alone.turn()
            alone.work()
        return store.campaigns.get(pair.campaign).digest


@pytest.fixture(params=["memory", "sqlite"])
def pair(request, tmp_path) -> Iterator[Pair]:
    now_s = [1_000.0]
    played = SimpleNamespace(monotonic=lambda: now_s[0])
    leases = SimpleNamespace(monotonic_ns=lambda: round(now_s[0] * 1e9), time_ns=time.time_ns)
    with ExitStack() as stack:
        for module in (worker_sessions, commits, supervisor):
            stack.enter_context(patch.object(module, "time", played))
        stack.enter_context(patch.object(clock, "time", leases))
        stack.enter_context(fake_learners())
        if request.param == "memory":
            stores = [open_store("memory://")] * 2
        else:
            stores = [open_store(f"sqlite:///{tmp_path / 'a.db'}") for _ in range(2)]
        for store in stores:
            stack.callback(store.close)
        yield Pair(stores, now_s)


@pytest.mark.fault(
    "two services on one database",
    group="storage",
    outcome="They share the campaigns out. One that stood still writes nothing more to a "
    "campaign that the other has taken over: see [who owns what](#who-owns-what).",
)
def test_a_campaign_is_run_by_one_of_them(pair: Pair) -> None:
    one, other = pair.services
    for _ in range(5):
        one.turn()
        other.turn()
    assert (one.runs(pair.campaign), other.runs(pair.campaign)) == (True, False)
    pair.end(one, other)
    assert not other.held


@pytest.mark.fault("two services on one database")
def test_who_was_held_up_puts_no_older_checkpoint_over_a_newer_one(pair: Pair) -> None:
    old, new = pair.taken_over()
    before = pair.progress
    with capture_logs() as lines:
        old.turn_hub()
    assert [line["event"] for line in lines if line["log_level"] == "warning"] == ["campaign lost"]
    assert pair.progress == before
    assert not old.runs(pair.campaign)
    assert not old.held
    pair.end(new, old)


@pytest.mark.fault("two services on one database")
@pytest.mark.parametrize("problem", ["", "The learner diverged."])
def test_nor_does_it_end_the_campaign(pair: Pair, problem) -> None:
    old, new = pair.taken_over()
    old.hub._halt(FinishedRun(pair.campaign, problem))
    before = pair.store.campaigns.get(pair.campaign)
    old.turn()
    after = pair.store.campaigns.get(pair.campaign)
    assert (after.state, after.active_s) == (before.state, before.active_s)
    pair.end(new, old)


@pytest.mark.fault("two services on one database")
def test_who_is_told_to_stop_gives_back_nothing_of_another_ones(pair: Pair) -> None:
    old, new = pair.taken_over()
    before = pair.store.campaigns.get(pair.campaign).active_s
    old.supervisor.release()
    assert pair.store.campaigns.get(pair.campaign).active_s == before
    assert pair.store.jobs.claim("a third one", LEASE_S) is None
    pair.end(new)


@pytest.mark.fault("two services on one database")
def test_it_halts_what_it_has_lost_and_can_take_it_over_again(pair: Pair) -> None:
    old, new = pair.taken_over()
    old.turn()
    assert not old.runs(pair.campaign)
    pair.now_s[0] += LEASE_S + 1.0
    for _ in range(3):
        old.turn()
    assert old.runs(pair.campaign)
    new.turn()
    assert not new.runs(pair.campaign)
    pair.end(old, new)


@pytest.mark.fault("two services on one database")
def test_what_comes_back_before_it_was_noticed_is_launched_anew(pair: Pair) -> None:
    old, new = pair.taken_over()
    new.supervisor.release()
    old.hub._halt(FinishedRun(pair.campaign, "", lost=True))
    for _ in range(3):
        old.turn()
    assert old.runs(pair.campaign)
    pair.end(old)


@pytest.mark.fault("two services on one database")
def test_results_are_taken_from_whoever_brings_them(pair: Pair) -> None:
    old, new = pair.taken_over()
    last = EPISODES - 1
    assert not pair.store.episodes.finished(pair.campaign, [last])
    old.say(messages.Results(pair.campaign, (result(last, seed=episode_seed(SPEC.seed, last)),)))
    for _ in range(2):
        old.turn()
    assert pair.store.episodes.finished(pair.campaign, [last])
    pair.end(new, old)


@pytest.mark.fault("two services on one database")
@pytest.mark.parametrize("seed", range(12))
def test_no_order_of_standstills_takes_a_checkpoint_back(pair: Pair, seed) -> None:
    draw, before = random.Random(seed), 0
    for _ in range(120):
        service = draw.choice(pair.services)
        draw.choice([service.turn, service.turn_hub, service.work, partial(service.work, 2)])()
        if draw.random() < 0.1:
            pair.now_s[0] += LEASE_S + 1.0
        assert pair.progress >= before
        before = pair.progress
    pair.end(*pair.services)
