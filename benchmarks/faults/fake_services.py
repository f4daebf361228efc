"""A hub with a fake socket and fake learners, all in this process."""

from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest.mock import patch

import numpy as np
import structlog
import zmq

from eigenfail.values.episode import EpisodeTask, PolicySource, PriorSource, episode_seed
from eigenfail.values.learning import Layer, LearnerContext, Policy, Round
from eigenfail.wire.messages import Message, Observed, Proposed, Start, Stop
from eigenfail_services.bounds import SettingBounds
from eigenfail_services.hub import runs, server
from eigenfail_services.hub.server import Hub
from eigenfail_services.store.store import Store

ROUND = 3
AHEAD = 2
"""Rounds that are open at a time."""

CRITICAL = 50
LAYER = Layer(np.zeros((2, 2), np.float32), np.zeros(2, np.float32))


class FakeSocket:
    """A ROUTER or DEALER: what comes in is put into `inbox`, what is sent lies in `outbox`."""

    def __init__(self) -> None:
        self.inbox: deque[Any] = deque()
        self.outbox: deque[Any] = deque()

    def recv_multipart(self, _flags: int) -> Any:
        """The next message.

        Raises:
            zmq.Again: there is none.
        """
        if not self.inbox:
            raise zmq.Again
        return self.inbox.popleft()

    def receive(self) -> tuple[bytes, bytes]:
        """First and last frame of the next message.

        Raises:
            zmq.Again: there is none.
        """
        parts = self.recv_multipart(zmq.NOBLOCK)
        return parts[0], parts[-1]

    def send_multipart(self, parts: Any, _flags: int) -> None:
        """Keep what is sent."""
        self.outbox.append(parts)

    recv, send = recv_multipart, send_multipart

    def getsockopt_string(self, _option: int) -> str:
        """Where it is bound."""
        return "played"

    def close(self) -> None:
        """Nothing to let go of."""


class FakeLearner:
    """Proposes rounds of three, two at a time, every second one with a policy of its own."""

    def __init__(self) -> None:
        self.socket = None
        self.status: int | None = None
        self.shown: list[int] = []
        self.words: deque[Message] = deque()
        self._heeding = {Start: self._start, Observed: self._observe, Stop: self._stop}
        self._episodes = self._done = self._seed = 0

    def send(self, message: Message) -> None:
        """Take a command."""
        self._heeding[type(message)](message)

    def receive(self) -> Message | None:
        """What it says to it."""
        return self.words.popleft() if self.words else None

    def exit_status(self) -> int | None:
        """None while it lives."""
        return self.status

    def stop(self) -> None:
        """It is gone."""

    def _start(self, message: Start) -> None:
        self._episodes, self._seed = message.context.episodes, message.campaign_seed
        self._done = int(message.checkpoint or b"0")
        self._propose()

    def _observe(self, message: Observed) -> None:
        self.shown += [result.index for result in message.results]
        self._done += len(message.results)
        self._propose()

    def _stop(self, _message: Stop) -> None:
        self.words.clear()

    def _propose(self) -> None:
        first = self._done // ROUND
        rounds = (self._round(number) for number in range(first, first + AHEAD))
        due = tuple(each for each in rounds if each.tasks)
        self.words.append(Proposed(due, str(self._done).encode()))

    def _round(self, number: int) -> Round:
        indices = range(number * ROUND, min((number + 1) * ROUND, self._episodes))
        policy = Policy(number, (), LAYER, LAYER, 3.0, 1) if number % 2 else None
        source = PolicySource(number) if policy else PriorSource()
        seeds = (episode_seed(self._seed, index) for index in indices)
        tasks = (EpisodeTask(i, seed, source) for i, seed in zip(indices, seeds, strict=True))
        return Round(number, tuple(tasks), policy)


def fake_hub(store: Store) -> tuple[Hub, FakeSocket]:
    """A hub that is driven by its `turn`, and its socket."""
    router = FakeSocket()
    with patch.object(server, "bind", lambda *_: router):
        return Hub(store, "played"), router


@contextmanager
def fake_learners() -> Iterator[list[FakeLearner]]:
    """Start fake learners in place of real ones within the block, and list them."""
    learners: list[FakeLearner] = []

    def start(_bounds: SettingBounds, _pause_s: float) -> FakeLearner:
        learners.append(FakeLearner())
        return learners[-1]

    with patch.object(runs.learner_link, "LearnerLink", start):
        yield learners


@contextmanager
def quiet() -> Iterator[None]:
    """Nothing below critical is logged meanwhile."""
    before = structlog.get_config()
    with ExitStack() as stack:
        stack.callback(structlog.configure, **before)
        structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(CRITICAL))
        yield


def context_of(episodes: int) -> LearnerContext:
    """What a learner of so many episodes is told."""
    return LearnerContext(0, episodes, 5, np.zeros((0, 5, 2), np.float32))
