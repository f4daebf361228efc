"""The inner process of a worker: simulator and planner live, and may die, here.

Reads setups, policies and leases from what was its standard input; writes to what was its standard
output: a `Heartbeat` when it can take episodes, and for each one a `Heartbeat` when it begins, with
the number of slots, and its `Results`. Whatever plug-ins print goes to standard error instead; to
them, nothing is typed in.
"""

import os
import select
import signal
import sys
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from eigenfail import logs, plugins
from eigenfail.contracts import EpisodeEngine, LockstepEngine
from eigenfail.errors import EigenfailError
from eigenfail.processes import end_now
from eigenfail.values import EpisodeFault, EpisodeResult, EpisodeSetup, EpisodeTask, unrunnable
from eigenfail.wire.messages import (
    Drop,
    Heartbeat,
    Lease,
    Message,
    PolicyUpdate,
    Results,
    Setup,
    read_hub_message,
)
from eigenfail_workers.worker.guard import leave_guard
from eigenfail_workers.worker.limits import confine, files_used_up
from eigenfail_workers.worker.one_by_one import side_by_side
from eigenfail_workers.worker.pipe import FrameBuffer, write_message


class Child:
    """Keeps one engine for each campaign, and runs what is leased, side by side where it can."""

    def __init__(self, out: BinaryIO, make_engine: Callable[[EpisodeSetup], EpisodeEngine]) -> None:
        self._out = out
        self._make_engine = make_engine
        self._engines: dict[int, LockstepEngine] = {}
        self._refused: dict[int, EpisodeFault] = {}
        self._waiting: deque[tuple[int, EpisodeTask]] = deque()
        self._running = 0
        self._campaign = 0
        self._handlers: dict[type[Message], Callable[..., None]] = {
            Setup: self._set_up,
            PolicyUpdate: self._learn,
            Lease: self._lease,
            Drop: self._forget,
        }

    def handle(self, message: Message) -> None:
        """Do what a message asks."""
        self._handlers[type(message)](message)

    def _set_up(self, message: Setup) -> None:
        try:
            self._engines[message.campaign] = side_by_side(self._make_engine(message.setup))
        except EigenfailError as error:
            self._refused[message.campaign] = EpisodeFault("input", str(error))

    def _learn(self, message: PolicyUpdate) -> None:
        if engine := self._engines.get(message.campaign):
            engine.learn(message.policy)

    def _lease(self, message: Lease) -> None:
        self._waiting.extend((message.campaign, task) for task in message.tasks)

    @property
    def is_busy(self) -> bool:
        """Whether there are episodes that run, or wait for room."""
        return bool(self._waiting or self._running)

    def turn(self) -> None:
        """Begin what there is room for, go on with what runs, and report what is over."""
        self._begin()
        if self._running:
            self._report(self._campaign, *self._engines[self._campaign].turn())

    def _begin(self) -> None:
        """Begin in the order of the leases; only one campaign's run side by side."""
        while self._waiting:
            campaign, task = self._waiting[0]
            engine = self._engines.get(campaign)
            if self._running and (campaign != self._campaign or engine is None or not engine.room):
                return
            self._waiting.popleft()
            self._campaign = campaign
            self._running += 1
            if engine is None:
                self._report(campaign, unrunnable(task, self._refused[campaign]))
                continue
            slots = max(1, self._running - 1 + engine.room)
            write_message(self._out, Heartbeat(campaign, task.index, slots=slots))
            engine.begin(task)

    def _forget(self, message: Drop) -> None:
        while self.is_busy:
            self.turn()
        self._refused.pop(message.campaign, None)
        if engine := self._engines.pop(message.campaign, None):
            engine.close()

    def _report(self, campaign: int, *results: EpisodeResult) -> None:
        self._running -= len(results)
        if results:
            write_message(self._out, Results(campaign, results))


def main() -> None:
    """Serve until the parent closes the pipe, or hardly a file can be opened any more.

    Files that a planner forgot to close would be paid for by the next episodes: they get a new
    process instead, at once, whatever threads it left as well.
    """
    leave_guard()
    logs.configure("worker")
    confine(*map(int, sys.argv[1:2]))
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    messages, out = _take_pipes()
    child = Child(out, plugins.load(plugins.ENGINES, "default"))
    write_message(out, Heartbeat())
    serve(child, messages.fileno())
    end_now(0)


def serve(child: Child, messages: int) -> None:
    """Handle what comes in, and run episodes in between; see `main` for the end."""
    buffer, poll = FrameBuffer(), select.poll()
    poll.register(messages, select.POLLIN)
    while not files_used_up():
        if not child.is_busy or poll.poll(0):
            if not buffer.read(messages):
                return
            for frame in buffer.frames():
                child.handle(read_hub_message(frame))
        child.turn()


def _take_pipes() -> tuple[BinaryIO, BinaryIO]:
    """From and to the parent; what plug-ins read and print, and what they start, goes elsewhere."""
    messages = os.fdopen(os.dup(0), "rb")
    # Open until the process has its exit status: the parent takes the end of the pipe for its end.
    out = os.fdopen(os.dup(1), "wb", closefd=False)
    with Path(os.devnull).open("rb") as nothing:
        os.dup2(nothing.fileno(), 0)
    os.dup2(2, 1)
    return messages, out


if __name__ == "__main__":
    main()
