"""A worker with a fake connection to its hub and a fake child, all in this process."""

import time
from collections.abc import Sequence
from io import BytesIO
from queue import SimpleQueue
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

from benchmarks.faults.fake_services import FakeSocket
from msgspec.structs import replace

from eigenfail.testing.examples import result
from eigenfail.values.episode import EpisodeResult, EpisodeSetup, EpisodeTask, PolicySource
from eigenfail.values.learning import Policy
from eigenfail.wire.messages import Assembler
from eigenfail_workers.limits import Limits
from eigenfail_workers.worker import hub_connection, parent
from eigenfail_workers.worker.child import Child
from eigenfail_workers.worker.child_process import ChildProcess, FrameBuffer


class FakeEngine:
    """Runs every episode at once; of a policy that it was not taught it cannot."""

    def __init__(self, _setup: EpisodeSetup) -> None:
        self.versions: set[int] = set()

    def add_policy(self, policy: Policy) -> None:
        """Take a policy version."""
        self.versions.add(policy.version)

    def run(self, tasks: Sequence[EpisodeTask]) -> list[EpisodeResult]:
        """The same result for the same task, wherever it is run."""
        for task in tasks:
            if isinstance(task.source, PolicySource) and task.source.version not in self.versions:
                raise KeyError(task.source.version)
        return [self.result(task) for task in tasks]

    def result(self, task: EpisodeTask) -> EpisodeResult:
        """What comes of a task; its noise is that of an index that a seed can have."""
        made = result(task.index % 50, seed=task.seed, source=task.source_kind)
        return replace(made, index=task.index)

    def close(self) -> None:
        """Nothing to let go of."""


class FakeBuffer(FrameBuffer):
    """Is given what a pipe would give."""

    def take(self, out: BytesIO) -> None:
        """All that was written."""
        self._bytes += out.getvalue()
        out.seek(0)
        out.truncate()


class FakeChild(ChildProcess):
    """The parent's handle, with all its bookkeeping, on a child without a process."""

    def __init__(self, _limits: Limits) -> None:
        self._messages = SimpleQueue()
        self._buffer = FakeBuffer()
        self._output: Any = SimpleNamespace(start_episode=lambda: None)
        self._start_records()
        self.ready = self.alive = True
        self._out = BytesIO()
        self._child = Child(self._out, FakeEngine)

    def work(self, messages: int) -> None:
        """Do what so many of the waiting messages ask.

        Raises:
            KeyError: of what was never set up or taught: a true child would die of it.
        """
        try:
            for _ in range(min(messages, self._messages.qsize())):
                self._child.handle(self._messages.get_nowait())
                while self._child.is_busy:
                    self._child.turn()
        finally:
            self._buffer.take(self._out)

    def listen(self) -> tuple[bool, list[tuple[int, EpisodeResult]]]:
        """Whether it lives, and the results that have come."""
        return self.alive, list(self._results())

    @property
    def descriptor(self) -> int:
        """Nothing will ever come out of it."""
        return 0

    def has_ended(self) -> bool:
        """Whether it was killed."""
        return not self.alive

    def find_excess(self) -> str:
        """It takes nothing."""
        return ""

    def memory_mib(self) -> float:
        """It takes nothing."""
        return 0.0

    def end(self) -> int:
        """As if it was killed."""
        return -9


class FakeLink(hub_connection.HubConnection):
    """A link without a socket below."""

    def __init__(self, address: str, _key: None = None) -> None:
        self.address = address
        self.socket: Any = FakeSocket()
        self._assembler = Assembler()
        self.handshakes: Any = SimpleNamespace(check=lambda: None, close=lambda: None)

    def reconnect(self) -> None:
        """There is one line, and it is sound."""


class FakeWorker(parent.Parent):
    """A worker that is driven by its `turn`, and whose child is by `work`."""

    def __init__(self, address: str = "", episode_limit_s: float = 60.0) -> None:
        """Of a hub at an address, or of one that is a fake."""
        made = hub_connection.HubConnection if address else FakeLink
        with (
            patch.object(parent, "HubConnection", made),
            patch.object(parent, "ChildProcess", FakeChild),
        ):
            limits = Limits(episode_s=episode_limit_s)
            super().__init__(address, "w", limits=limits)

    @property
    def dealer(self) -> FakeSocket:
        """Its end of the connection."""
        return self._hub.socket

    @property
    def child(self) -> FakeChild:
        """The present one."""
        return self._child

    def turn(self, child_spoke: bool = True) -> None:
        """One turn; a child that it begins is a fake one."""
        with patch.object(parent, "ChildProcess", FakeChild):
            super().turn(child_spoke)

    def work(self, messages: int = 100) -> None:
        """Let the child do what it can; a true one would die of what it cannot."""
        try:
            self.child.work(messages)
        except Exception:  # noqa: BLE001 - whatever it dies of
            self.child.alive = False

    def serve(self) -> None:
        """The loop, with the child's work between two turns."""
        while not self._shutdown.requested:
            self.turn()
            self.work()
            time.sleep(0.001)
        self._hub.close()
