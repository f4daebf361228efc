"""The child process of a worker: simulator and planner run, and may crash, here.

The child reads setups, policies and leases from its original standard input. It writes a
`Heartbeat` to its original standard output when it can take episodes. For each episode it writes a
`Heartbeat` at the start, with the number of slots, and then the `Results`. Plug-ins print to
standard error instead, and read an empty input.
"""

import os
import select
import signal
import sys
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import structlog

from eigenfail import logs, plugins
from eigenfail.contracts import EpisodeEngine, LockstepEngine
from eigenfail.errors import EigenfailError, describe_error, read_text
from eigenfail.process_state import ProcessState
from eigenfail.processes import end_now
from eigenfail.values import episode
from eigenfail.wire import messages
from eigenfail_workers.limits import RENEWAL, apply_kernel_limits, is_out_of_files
from eigenfail_workers.worker.child_process import FrameBuffer, write_message
from eigenfail_workers.worker.guard import fork_under_guard

log = structlog.get_logger()


class SequentialEngine:
    """Adapts an engine that runs one episode at a time. Implements `LockstepEngine`."""

    def __init__(self, engine: EpisodeEngine) -> None:
        self._engine = engine
        self._begun: list[episode.EpisodeTask] = []
        self.add_policy = engine.add_policy
        self.run = engine.run
        self.close = engine.close

    @property
    def room(self) -> int:
        """Number of episodes that may begin: 1, or 0 after `begin`."""
        return 1 - len(self._begun)

    def begin(self, task: episode.EpisodeTask) -> None:
        """Keep the episode for the next turn."""
        self._begun.append(task)

    def turn(self) -> list[episode.EpisodeResult]:
        """Run the episode."""
        begun, self._begun = self._begun, []
        return list(self._engine.run(begun))


def as_lockstep(engine: EpisodeEngine) -> LockstepEngine:
    """Return the engine itself if it runs episodes side by side, else an adapter."""
    return engine if isinstance(engine, LockstepEngine) else SequentialEngine(engine)


class Child:
    """Keeps one engine for each campaign, and runs the episodes of leases, if possible in parallel.

    Args:
        out: where messages are written.
        make_engine: makes the engine of a campaign.

    Attributes:
        is_altered: whether an episode has changed process-wide state, so that no further episode
            may run in this process.
    """

    def __init__(
        self, out: BinaryIO, make_engine: Callable[[episode.EpisodeSetup], EpisodeEngine]
    ) -> None:
        self._out = out
        self._make_engine = make_engine
        self._engines: dict[int, LockstepEngine] = {}
        self._refused: dict[int, episode.EpisodeFault] = {}
        # Kept apart from `_refused`: a refusal is the result of each episode, and a declined
        # campaign has no results here, as another worker may be able to run it.
        self._declined: set[int] = set()
        self._waiting: deque[tuple[int, episode.EpisodeTask]] = deque()
        self._running = 0
        self._campaign = 0
        self._process_state = ProcessState()
        self.is_altered = False
        self._handlers: dict[type[messages.Message], Callable[..., None]] = {
            messages.Setup: self._set_up,
            messages.PolicyUpdate: self._learn,
            messages.Lease: self._accept_lease,
            messages.Drop: self._drop,
        }

    def handle(self, message: messages.Message) -> None:
        """Process one message of the parent."""
        self._handlers[type(message)](message)

    def _set_up(self, message: messages.Setup) -> None:
        before = ProcessState()
        try:
            self._engines[message.campaign] = as_lockstep(self._make_engine(message.setup))
        except EigenfailError as error:
            self._refused[message.campaign] = episode.EpisodeFault("input", read_text(error))
        except BaseException as error:  # noqa: BLE001 - a plug-in may raise anything; no Ctrl-C here
            problem = f"Making simulator and scenario raised {describe_error(error)}. "
            remedy = "Look into what they do when they are made."
            self._refused[message.campaign] = episode.EpisodeFault("simulator", problem + remedy)
        if changes := before.changes():
            log.warning("process state changed by imports", campaign=message.campaign, what=changes)
        self._process_state = ProcessState()

    def _learn(self, message: messages.PolicyUpdate) -> None:
        if engine := self._engines.get(message.campaign):
            engine.add_policy(message.policy)

    def _accept_lease(self, message: messages.Lease) -> None:
        # A lease may cross the message that declines its campaign: the hub leases it elsewhere.
        if message.campaign not in self._declined:
            self._waiting.extend((message.campaign, task) for task in message.tasks)

    @property
    def is_busy(self) -> bool:
        """True if episodes run or wait."""
        return bool(self._waiting or self._running)

    def turn(self) -> None:
        """Begin the episodes that have room, advance those that run, and report results."""
        self._begin()
        if self._running:
            engine = self._engines[self._campaign]
            results = engine.turn()
            if reason := getattr(engine, "declined", ""):
                self._decline(self._campaign, reason)
            else:
                self._report(self._campaign, *results)

    def _decline(self, campaign: int, reason: str) -> None:
        """Run no more episodes of a campaign: each would fail for the same reason."""
        self._engines.pop(campaign).close()
        self._declined.add(campaign)
        self._running = 0
        self._waiting = deque(each for each in self._waiting if each[0] != campaign)
        write_message(
            self._out, messages.Heartbeat(declined=((campaign, reason[: messages.LONGEST_REASON]),))
        )

    def _begin(self) -> None:
        """Begin episodes in the order of the leases; those that run belong to one campaign."""
        while self._waiting:
            campaign, task = self._waiting[0]
            engine = self._engines.get(campaign)
            # Episodes side by side belong to one engine. Another campaign waits until all of them
            # have ended.
            if self._running and (campaign != self._campaign or engine is None or not engine.room):
                return
            self._waiting.popleft()
            self._campaign = campaign
            self._running += 1
            if engine is None:
                self._report(campaign, episode.unrunnable(task, self._refused[campaign]))
                continue
            slots = max(1, self._running - 1 + engine.room)
            write_message(self._out, messages.Heartbeat(campaign, task.index, slots=slots))
            engine.begin(task)

    def _drop(self, message: messages.Drop) -> None:
        while self.is_busy and not self.is_altered:
            self.turn()
        self._refused.pop(message.campaign, None)
        self._declined.discard(message.campaign)
        if engine := self._engines.pop(message.campaign, None):
            engine.close()

    def _report(self, campaign: int, *results: episode.EpisodeResult) -> None:
        self._running -= len(results)
        if results:
            write_message(self._out, messages.Results(campaign, results))
        # Engines report changed process-wide state as a fault, so that only faults need a check.
        if any(result.fault for result in results):
            self.is_altered = bool(self._process_state.changes())


def main() -> None:
    """Serve until the parent closes the pipe, or until a fresh process is needed.

    A fresh process is needed when files that a planner has not closed use up the limit of open
    files, or when an episode has changed process-wide state. The exit status informs the parent,
    which starts a new process at once, even if threads still run in this one.
    """
    fork_under_guard()
    logs.configure("worker")
    # After the fork: the guard must not be the first that the kernel kills for want of memory.
    apply_kernel_limits(*map(int, sys.argv[1:2]))
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    inbox, out = _redirect_standard_streams()
    # Before the first import of a plug-in: what it sets then stays, and its episodes may rely on
    # it.
    plugins.keep_import_effects()
    child = Child(out, plugins.load(plugins.ENGINES, "default"))
    write_message(out, messages.Heartbeat())
    end_now(serve(child, inbox.fileno()))


def serve(child: Child, inbox: int) -> int:
    """Handle messages, and run episodes between them, until the end described in `main`.

    Args:
        child: handles the messages.
        inbox: file descriptor of the pipe from the parent.

    Returns:
        exit status: `RENEWAL` if a fresh process must run the remaining episodes.
    """
    buffer, poll = FrameBuffer(), select.poll()
    poll.register(inbox, select.POLLIN)
    while not (child.is_altered or is_out_of_files()):
        if not child.is_busy or poll.poll(0):
            if not buffer.read(inbox):
                return 0
            for frame in buffer.frames():
                child.handle(messages.read_hub_message(frame))
        # Dropping a campaign runs its episodes first, which may have changed the process.
        if not child.is_altered:
            child.turn()
    return RENEWAL


def _redirect_standard_streams() -> tuple[BinaryIO, BinaryIO]:
    """Return the pipes from and to the parent, and redirect the streams that plug-ins use."""
    inbox = os.fdopen(os.dup(0), "rb")
    # Never closed before the process exits, as the parent takes the end of the pipe for the exit.
    out = os.fdopen(os.dup(1), "wb", closefd=False)
    with Path(os.devnull).open("rb") as nothing:
        os.dup2(nothing.fileno(), 0)
    os.dup2(2, 1)
    return inbox, out


if __name__ == "__main__":
    main()
