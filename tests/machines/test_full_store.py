"""While results cannot be kept no new work is handed out; when they can, it goes on by itself."""

from types import SimpleNamespace

import pytest
from accepted import accept_spec
from benchmarks.faults.fake_services import context_of, fake_hub, fake_learners, quiet

from eigenfail.errors import StoreUnwritable
from eigenfail.testing.examples import result, spec
from eigenfail.wire.messages import (
    PROTOCOL,
    Ack,
    Hello,
    Lease,
    Message,
    Results,
    encode,
    read_hub_message,
)
from eigenfail_services.hub import commits, worker_sessions
from eigenfail_services.hub.runs import RunSpec
from eigenfail_services.store.store import open_store

EPISODES = 12


class Room:
    """A hub with one campaign and one worker of credit 2, on a store that may be full."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, part: str, verb: str) -> None:
        self.now_s, self.full = 100.0, False
        clock = SimpleNamespace(monotonic=lambda: self.now_s)
        monkeypatch.setattr(worker_sessions, "time", clock)
        monkeypatch.setattr(commits, "time", clock)
        self.store = open_store("memory://")
        self.break_(monkeypatch, part, verb)
        self.hub, self.router = fake_hub(self.store)
        self.campaign = self.store.campaigns.create(accept_spec(spec(episodes=EPISODES))).id
        order = RunSpec(self.campaign, spec().setup(), "monte_carlo", {}, 0, context_of(EPISODES))
        self.hub.launch(order)

    def break_(self, monkeypatch: pytest.MonkeyPatch, part: str, verb: str) -> None:
        whole = getattr(getattr(self.store, part), verb)

        def may_be_full(*words, **more):
            if self.full:
                raise StoreUnwritable("The disk is full.")
            return whole(*words, **more)

        monkeypatch.setattr(getattr(self.store, part), verb, may_be_full)

    def say(self, *messages: Message) -> list[Message]:
        """What the hub answers to the worker in the same turn, and a second later."""
        self.router.inbox.extend([b"w", encode(message)] for message in messages)
        self.now_s += 1.0
        self.hub.turn()
        said = [read_hub_message(data) for _, data in self.router.outbox]
        self.router.outbox.clear()
        return said


def leased(said: list[Message]) -> list[int]:
    return [task.index for one in said if isinstance(one, Lease) for task in one.tasks]


def acked(said: list[Message]) -> list[int]:
    return [index for one in said if isinstance(one, Ack) for index in one.indices]


@pytest.fixture
def enter(monkeypatch: pytest.MonkeyPatch):
    """Makes a room in which one verb of the store may fail."""
    with quiet(), fake_learners():
        yield lambda part, verb: Room(monkeypatch, part, verb)


@pytest.mark.fault("disk full")
def test_leasing_pauses_while_results_cannot_be_kept(enter) -> None:
    room = enter("episodes", "commit")
    room.say()
    first = leased(room.say(Hello(PROTOCOL, "w", 2)))
    room.full = True
    second = leased(room.say(Results(room.campaign, tuple(map(result, first)))))
    assert second  # nobody knows yet
    room.say()
    brought = [*first, *second]
    said = room.say(Results(room.campaign, tuple(map(result, second))))
    for _ in range(3):  # it is tried again each second, and between two tries nothing is leased
        assert (acked(said), leased(said)) == ([], [])
        room.now_s -= 0.9
        said = room.say()
    room.full = False
    said = [*room.say(), *room.say()]
    assert sorted(acked(said)) == sorted(brought)
    assert leased(said)
    assert room.store.campaigns.get(room.campaign).counts.completed == len(brought)


@pytest.mark.fault("disk full")
def test_leasing_pauses_while_a_learner_cannot_be_kept(enter) -> None:
    room = enter("checkpoints", "save")
    room.full = True
    room.say()
    assert leased(room.say(Hello(PROTOCOL, "w", 2))) == []
    room.full = False
    # The first turn finds that the store is there again, and the next one leases.
    assert leased([*room.say(), *room.say()])
