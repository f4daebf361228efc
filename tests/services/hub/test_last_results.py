"""A learner that waits for the last results of its round does not wait for others beside them."""

import time
from collections.abc import Callable, Iterator

import deadlines
import pytest
import zmq
from store_checks.examples import running

from eigenfail.values.episode import EpisodeFault, EpisodeTask, unrunnable
from eigenfail.wire import messages
from eigenfail_services.campaigns.references import learner_context
from eigenfail_services.hub import commits
from eigenfail_services.hub.runs import RunSpec
from eigenfail_services.hub.server import Hub
from eigenfail_services.store.store import open_store

pytestmark = pytest.mark.service

DEADLINE_S = deadlines.PROCESS_S
EPISODES = 4


class Room:
    """A hub whose turns the test takes, and a worker that it plays."""

    def __init__(self) -> None:
        self.store = open_store("memory://")
        self.hub = Hub(self.store, "tcp://127.0.0.1:*")
        self.worker: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
        self.worker.connect(self.hub.address)
        self.worker.send(messages.encode(messages.Hello(messages.PROTOCOL, "w", 64)))
        campaign = running(self.store, episodes=EPISODES)
        self.campaign, spec = campaign.id, campaign.spec
        context = learner_context(campaign, self.store)
        order = RunSpec(self.campaign, spec.setup(), spec.method, spec.settings, spec.seed, context)
        self.hub.launch(order)

    def until(self, condition: Callable[[], bool], act: Callable[[], None] | None = None) -> None:
        deadline_s = time.monotonic() + DEADLINE_S
        while not condition():
            assert time.monotonic() < deadline_s, "it did not come to that"
            (act or self.hub.turn)()

    def leased(self) -> list[EpisodeTask]:
        """All episodes, once the worker has them."""
        tasks: list[EpisodeTask] = []
        while len(tasks) < EPISODES:
            self.until(lambda: bool(self.worker.poll(5)))
            message = messages.read_hub_message(self.worker.recv())
            tasks += message.tasks if isinstance(message, messages.Lease) else ()
        return tasks

    def bring(self, *tasks: EpisodeTask) -> None:
        fault = EpisodeFault("input", "test")
        results = tuple(unrunnable(task, fault) for task in tasks)
        self.worker.send(messages.encode(messages.Results(self.campaign, results)))

    def finished(self) -> int:
        return self.store.campaigns.get(self.campaign).counts.errored


@pytest.fixture
def room(monkeypatch: pytest.MonkeyPatch) -> Iterator[Room]:
    monkeypatch.setattr(commits, "MAX_WAIT_S", 3_600.0)
    room = Room()
    yield room
    room.hub.halt(room.campaign)
    room.hub.turn()
    room.hub.stop()
    room.worker.close(linger=0)


def test_results_wait_while_others_are_run_and_the_last_one_is_written_at_once(room: Room) -> None:
    *most, last = room.leased()
    room.bring(*most)
    for _ in range(50):
        room.worker.poll(5)  # it takes a moment until they have come
        room.hub.turn()
    assert room.finished() == 0
    room.bring(last)
    room.until(lambda: room.finished() == EPISODES)


def test_the_hub_hears_its_workers_while_a_transaction_is_committed(
    room: Room, monkeypatch: pytest.MonkeyPatch
) -> None:
    tasks = room.leased()
    whole = room.store.episodes.commit
    heard: list[messages.Message] = []

    def commit(campaign, deliveries, meanwhile):
        def hear() -> None:
            if heard:
                return
            room.worker.send(messages.encode(messages.Heartbeat()))
            room.until(lambda: bool(room.worker.poll(5)), meanwhile)
            heard.append(messages.read_hub_message(room.worker.recv()))

        return whole(campaign, deliveries, hear)

    monkeypatch.setattr(room.store.episodes, "commit", commit)
    room.bring(*tasks)
    room.until(lambda: bool(heard))
    (answer,) = heard
    assert isinstance(answer, messages.Ack)
    assert answer.indices == ()
    assert room.finished() == EPISODES
    acknowledged = messages.read_hub_message(room.worker.recv())
    assert isinstance(acknowledged, messages.Ack)
    assert acknowledged.indices == tuple(task.index for task in tasks)
