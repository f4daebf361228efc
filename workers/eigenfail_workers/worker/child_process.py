"""The parent's handle on its child: start, feed, listen, watch, and kill with all it started."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator
from queue import SimpleQueue
from threading import Thread
from typing import BinaryIO

import msgspec
from msgspec.structs import replace

from eigenfail.bridges import EPISODE_VARIABLE
from eigenfail.errors import ProtocolError, ServiceError
from eigenfail.processes import ONE_THREAD, as_parent, exit_status, kill_group, status_within
from eigenfail.values import EpisodeResult, EpisodeSetup, EpisodeTask, Policy
from eigenfail.wire.messages import (
    Drop,
    Heartbeat,
    Lease,
    Message,
    PolicyUpdate,
    Results,
    Setup,
    read_worker_message,
)
from eigenfail_workers.worker.limits import Limits
from eigenfail_workers.worker.pipe import FrameBuffer, write_message
from eigenfail_workers.worker.watch import Watch

START_LIMIT_S = 120.0
"""Wall time for loading the simulator and the planner, before the first episode begins."""

STANDSTILL_S = 2.0
"""No parent is away from its loop for so long, unless it was stopped or its machine was."""

GUARD_S = 5.0
"""More than its guard takes to end it and all that it started; else it is killed without."""

LAST_WORDS_S = 1.0
"""What left the child's group may hold its pipe open; the parent does not wait for that."""

DEPTH = 2
"""Episodes in the child for each that runs: as many wait as run, so that the child never does."""


class Held(msgspec.Struct, frozen=True, eq=False):
    """An episode of a campaign, held by this worker; unwanted once its campaign was dropped."""

    campaign: int
    task: EpisodeTask
    wanted: bool = True

    def without(self, campaign: int) -> "Held":
        """Itself, unwanted if it is that campaign's."""
        return replace(self, wanted=self.wanted and self.campaign != campaign)


def write_all(pipe: BinaryIO, messages: "SimpleQueue[Message | None]") -> None:
    """Write messages until there is a None or nobody reads any more."""
    with contextlib.suppress(BrokenPipeError):
        while message := messages.get():
            write_message(pipe, message)
    with contextlib.suppress(BrokenPipeError):
        pipe.close()


def start(limits: Limits) -> "subprocess.Popen[bytes]":
    """The guard of the inner process, which it starts, and as which it ends.

    Raises:
        ServiceError: the system starts no process.
    """
    try:
        return subprocess.Popen(
            [sys.executable, "-m", "eigenfail_workers.worker.child", str(limits.files)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | ONE_THREAD | as_parent() | {EPISODE_VARIABLE: str(limits.episode_s)},
            start_new_session=True,
        )
    except OSError as error:
        raise not_started(error) from error


def not_started(error: Exception) -> ServiceError:
    """What is said of a process or thread that the system does not start."""
    return ServiceError(
        f"No inner process can be started here: {error}.",
        "End other programs, or run fewer workers on this machine.",
    )


class ChildProcess:
    """One life of the inner process.

    Args:
        limits: what it may take, with all that it starts.

    Attributes:
        running: the episodes it holds; those that were begun are the first.
        ready: whether it said that it can take episodes.
        begun: on how many of them it said that it began.

    Raises:
        ServiceError: the system starts no process.
    """

    def __init__(self, limits: Limits) -> None:
        self._process = start(limits)
        if self._process.stdin is None or self._process.stdout is None:
            raise RuntimeError("pipes were asked for")
        self._stdout = self._process.stdout
        os.set_blocking(self._stdout.fileno(), False)
        self._watch = Watch(self._process.pid, limits)
        # A thread writes: parent and child never wait for each other over two full pipes.
        self._messages: SimpleQueue[Message | None] = SimpleQueue()
        pipe_and_messages = (self._process.stdin, self._messages)
        self._writer = Thread(target=write_all, args=pipe_and_messages, daemon=True)
        try:
            self._writer.start()
        except RuntimeError as error:  # the process was the last that the system had to give
            with self._process:
                kill_group(self._process)
            raise not_started(error) from error
        self._buffer = FrameBuffer()
        self.running: deque[Held] = deque()
        self.ready = False
        self.begun = 0
        self._since_s = self._looked_s = time.monotonic()
        self._slots: dict[int, int] = {}
        self._set_up: set[int] = set()
        self._learnt: set[tuple[int, int]] = set()

    @property
    def descriptor(self) -> int:
        """What to poll for results."""
        return self._stdout.fileno()

    @property
    def has_room(self) -> bool:
        """Whether it may be given another episode."""
        return len(self.running) < DEPTH * max(1, self.begun)

    def slots(self, campaign: int) -> int:
        """How many episodes of a campaign it runs side by side, as far as it has told."""
        return self._slots.get(campaign, 1)

    def set_up(self, campaign: int, setup: EpisodeSetup) -> None:
        """Tell it, once, what the episodes of a campaign share."""
        if campaign not in self._set_up:
            self._set_up.add(campaign)
            self._messages.put(Setup(campaign, setup))

    def learn(self, campaign: int, policy: Policy) -> None:
        """Tell it, once, a policy version of a campaign."""
        if (campaign, policy.version) not in self._learnt:
            self._learnt.add((campaign, policy.version))
            self._messages.put(PolicyUpdate(campaign, policy))

    def drop(self, campaign: int) -> None:
        """Let it forget a campaign, once it has run what it holds."""
        self._set_up.discard(campaign)
        self._slots.pop(campaign, None)
        self._learnt = {key for key in self._learnt if key[0] != campaign}
        self.running = deque(held.without(campaign) for held in self.running)
        self._messages.put(Drop(campaign))

    def run(self, held: Held) -> None:
        """Give it an episode; that the child has died is found out when it is listened to."""
        if not self.running:
            self._since_s = time.monotonic()
        self.running.append(held)
        self._messages.put(Lease(held.campaign, (held.task,)))

    def listen(self) -> tuple[bool, list[tuple[int, EpisodeResult]]]:
        """Whether it lives and makes sense; the results that have come, with their campaigns."""
        alive = self._buffer.read(self.descriptor)
        found: list[tuple[int, EpisodeResult]] = []
        try:
            # What came before the nonsense stays.
            found.extend(self._results())
        except ProtocolError:
            return False, found
        return alive, found

    def _results(self) -> Iterator[tuple[int, EpisodeResult]]:
        for frame in self._buffer.frames():
            message = read_worker_message(frame)
            self._since_s = time.monotonic()
            self.ready = True
            if isinstance(message, Heartbeat) and message.campaign is not None:
                self.begun += 1
                self._slots[message.campaign] = message.slots
            if isinstance(message, Results):
                for result in message.results:
                    self._take_off(message.campaign, result.index)
                    yield message.campaign, result

    def _take_off(self, campaign: int, index: int) -> None:
        for place, held in enumerate(self.running):
            if (held.campaign, held.task.index) == (campaign, index):
                del self.running[place]
                self.begun = max(self.begun - 1, 0)
                return
        raise ProtocolError("A result came from the child that nobody asked for.")

    def overdue(self, limit_s: float) -> bool:
        """Whether the running episode, or loading what it needs, has taken longer than it may.

        To be asked all the time: while nobody asked, the whole worker may have stood still.
        """
        now_s, before_s = time.monotonic(), self._looked_s
        self._looked_s = now_s
        if now_s - before_s > STANDSTILL_S:
            self._since_s += now_s - before_s
        limit_s = limit_s * self.begun if self.begun else START_LIMIT_S
        return bool(self.running) and now_s - self._since_s > limit_s

    def excess(self) -> str:
        """What it takes more of than it may, as the predicate of a sentence; empty if nothing."""
        first = self.running[0] if self.running else None
        named = (first.campaign, first.task.index) if first else None
        return self._watch.excess(named, max(1, self.begun))

    def has_ended(self) -> bool:
        """Whether it runs no more, though what it started may still hold its pipe open."""
        return exit_status(self._process) is not None

    def end(self) -> int:
        """Have its guard kill what lives of it and of its own; its exit status, or -signal."""
        if self._process.returncode is None:
            os.kill(self._process.pid, signal.SIGTERM)
            status_within(self._process, GUARD_S)
            kill_group(self._process)
        self._messages.put(None)
        self._writer.join(LAST_WORDS_S)
        self._stdout.close()
        return self._process.wait()
