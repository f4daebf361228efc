"""A hub with one campaign, whose messages and clock a test sets."""

from types import SimpleNamespace

import pytest
from accepted import accept_spec
from benchmarks.faults.fake_services import context_of, fake_hub

from eigenfail.testing.examples import spec
from eigenfail.wire.messages import Lease, Message, encode, read_hub_message
from eigenfail_services.hub import commits, worker_sessions
from eigenfail_services.hub.runs import RunSpec
from eigenfail_services.store.store import open_store


class Room:
    """A hub that runs one campaign, and its clock."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, episodes: int) -> None:
        self.now_s = 100.0
        clock = SimpleNamespace(monotonic=lambda: self.now_s)
        monkeypatch.setattr(worker_sessions, "time", clock)
        monkeypatch.setattr(commits, "time", clock)
        self.store = open_store("memory://")
        self.hub, self.router = fake_hub(self.store)
        self.campaign = self.store.campaigns.create(accept_spec(spec(episodes=episodes))).id
        context = context_of(episodes)
        self.hub.launch(RunSpec(self.campaign, spec().setup(), "monte_carlo", {}, 0, context))

    def say(self, *messages: Message, by: bytes = b"w") -> list[Message]:
        """What the hub answers to a worker in the same turn, and a second later."""
        self.router.inbox.extend([by, encode(message)] for message in messages)
        self.now_s += 1.0
        self.hub.turn()
        said = [read_hub_message(data) for to, data in self.router.outbox if to == by]
        self.router.outbox.clear()
        return said


def leased(said: list[Message]) -> list[int]:
    """The episodes that a worker is given by what it is told."""
    return [task.index for one in said if isinstance(one, Lease) for task in one.tasks]
