"""The inner process of a worker: simulator and planner live, and may die, here.

Reads setups, policies and leases from what was its standard input; writes to what was its standard
output: a `Heartbeat` when it can take episodes, and for each one a `Heartbeat` when it begins, and
its `Results`. Whatever plug-ins print goes to standard error instead; to them, nothing is typed in.
"""

import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from eigenfail import plugins
from eigenfail.contracts import EpisodeEngine
from eigenfail.errors import EigenfailError
from eigenfail.processes import die_with_parent, end_now
from eigenfail.values import EpisodeFault, EpisodeResult, EpisodeSetup, unrunnable
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
from eigenfail_workers.worker.limits import files_used_up
from eigenfail_workers.worker.pipe import read_frames, write_message


class Child:
    """Keeps one engine for each campaign, and runs what is leased."""

    def __init__(self, out: BinaryIO, make_engine: Callable[[EpisodeSetup], EpisodeEngine]) -> None:
        self._out = out
        self._make_engine = make_engine
        self._engines: dict[int, EpisodeEngine] = {}
        self._refused: dict[int, EpisodeFault] = {}
        self._handlers: dict[type[Message], Callable[..., None]] = {
            Setup: self._set_up,
            PolicyUpdate: self._learn,
            Lease: self._run,
            Drop: self._forget,
        }

    def handle(self, message: Message) -> None:
        """Do what a message asks."""
        self._handlers[type(message)](message)

    def _set_up(self, message: Setup) -> None:
        try:
            self._engines[message.campaign] = self._make_engine(message.setup)
        except EigenfailError as error:
            self._refused[message.campaign] = EpisodeFault("input", str(error))

    def _learn(self, message: PolicyUpdate) -> None:
        if engine := self._engines.get(message.campaign):
            engine.learn(message.policy)

    def _run(self, message: Lease) -> None:
        engine = self._engines.get(message.campaign)
        if engine is None:
            fault = self._refused[message.campaign]
            self._report(message.campaign, *(unrunnable(task, fault) for task in message.tasks))
            return
        for task in message.tasks:
            write_message(self._out, Heartbeat(message.campaign, task.index))
            self._report(message.campaign, *engine.run([task]))

    def _forget(self, message: Drop) -> None:
        self._refused.pop(message.campaign, None)
        if engine := self._engines.pop(message.campaign, None):
            engine.close()

    def _report(self, campaign: int, *results: EpisodeResult) -> None:
        write_message(self._out, Results(campaign, results))


def main() -> None:
    """Serve until the parent closes the pipe, or hardly a file can be opened any more.

    Files that a planner forgot to close would be paid for by the next episodes: they get a new
    process instead, at once, whatever threads it left as well.
    """
    die_with_parent()
    leave_guard()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    messages, out = _take_pipes()
    child = Child(out, plugins.load(plugins.ENGINES, "default"))
    write_message(out, Heartbeat())
    for frame in read_frames(messages):
        child.handle(read_hub_message(frame))
        if files_used_up():
            break
    end_now(0)


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
