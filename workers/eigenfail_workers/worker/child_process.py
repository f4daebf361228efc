"""The parent's handle on its child process: start it, send it episodes, watch it, and kill it."""

import contextlib
import os
import signal
import struct
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

from eigenfail import processes
from eigenfail.bridges import EPISODE_VARIABLE
from eigenfail.errors import ProtocolError, ServiceError
from eigenfail.values.episode import EpisodeResult, EpisodeSetup, EpisodeTask
from eigenfail.values.learning import Policy
from eigenfail.wire import messages
from eigenfail_workers.limits import Limits
from eigenfail_workers.worker import resources

# A pipe has no borders of messages: each is preceded by its length.
LENGTH = struct.Struct("<I")


CHUNK_BYTES = 1 << 20


def write_message(pipe: BinaryIO, message: messages.Message) -> None:
    """Write one message and flush it.

    Raises:
        BrokenPipeError: the reading end of the pipe is closed.
    """
    data = messages.encode(message)
    pipe.write(LENGTH.pack(len(data)) + data)
    pipe.flush()


class FrameBuffer:
    """Collects the bytes of a pipe as they arrive, and yields complete frames."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def read(self, descriptor: int) -> bool:
        """Read the bytes that have arrived; return False at the end of the pipe."""
        try:
            data = os.read(descriptor, CHUNK_BYTES)
        except BlockingIOError:
            return True
        self._bytes += data
        return bool(data)

    def frames(self) -> Iterator[bytes]:
        """Yield and remove the complete frames.

        Raises:
            ProtocolError: a frame claims to be larger than any message.
        """
        while len(self._bytes) >= LENGTH.size:
            (length,) = LENGTH.unpack_from(self._bytes)
            if length > messages.MAX_MESSAGE_BYTES:
                raise ProtocolError(f"A frame of {length} bytes came from the child.")
            end = LENGTH.size + length
            if len(self._bytes) < end:
                return
            frame = bytes(self._bytes[LENGTH.size : end])
            del self._bytes[:end]
            yield frame


START_LIMIT_S = 120.0
"""Wall time for loading the simulator and the planner, before the first episode begins."""


STANDSTILL_S = 2.0
"""A parent that does not return to its loop for longer was stopped, or its machine was."""


GUARD_S = 5.0
"""Time for the guard to kill the child and its descendants; after it they are killed directly."""


JOIN_S = 1.0
"""Time for the threads to end. A process that left the group of the child may keep its pipe open;
the parent does not wait for that."""


EPISODES_PER_SLOT = 2
"""Episodes in the child for each one that runs: one waits, so that no slot is ever idle."""


RETRY_S = 1.0


NO_DESCRIPTOR = -1
"""A descriptor that `poll` ignores."""


class HeldEpisode(msgspec.Struct, frozen=True, eq=False):
    """An episode that this worker holds; unwanted once its campaign has been dropped."""

    campaign: int
    task: EpisodeTask
    wanted: bool = True

    def without(self, campaign: int) -> "HeldEpisode":
        """Return the same episode, unwanted if it belongs to the campaign."""
        return replace(self, wanted=self.wanted and self.campaign != campaign)


class ChildProcess:
    """One child process, from its start to its end.

    Args:
        limits: for the child and its descendants together.

    Attributes:
        running: the episodes in the child; begun episodes come first.
        ready: whether the child has reported that it can take episodes.
        begun: number of episodes that the child has begun.
        has_campaigns: whether the child has been sent a campaign.
        declined: reason why the child cannot run any episode of a campaign, by campaign.

    Raises:
        ServiceError: the operating system cannot start a process.
    """

    has_campaigns = False

    def __init__(self, limits: Limits) -> None:
        self._process = _start_child(limits)
        pipes = self._process.stdin, self._process.stdout, self._process.stderr
        if pipes[0] is None or pipes[1] is None or pipes[2] is None:
            raise RuntimeError("pipes were asked for")
        self._stdout = pipes[1]
        self._output = resources.OutputLimiter(pipes[2], limits.output_kib)
        # The loop of the parent serves the hub, too: it must never wait for half a message.
        os.set_blocking(self._stdout.fileno(), False)
        self._monitor = resources.ResourceMonitor(self._process.pid, limits)
        # A thread writes: parent and child never wait for each other over two full pipes.
        self._messages: SimpleQueue[messages.Message | None] = SimpleQueue()
        pipe_and_messages = (pipes[0], self._messages)
        self._writer = Thread(target=_write_messages, args=pipe_and_messages, daemon=True)
        try:
            self._writer.start()
            self._output.start()
        except RuntimeError as error:  # the process was the last one that the system could start
            self._messages.put(None)  # the writer may have been started before the other thread
            with self._process:
                processes.kill_group(self._process)
            raise _make_start_error(error) from error
        self._buffer = FrameBuffer()
        self._start_records()

    def _start_records(self) -> None:
        """Set the records of a child that has just begun; `NullChild` has them, too."""
        self.running: deque[HeldEpisode] = deque()
        self.ready = False
        self.begun = 0
        self.declined: dict[int, str] = {}
        self._progress_s = self._checked_s = time.monotonic()
        self._slots: dict[int, int] = {}
        self._set_up: set[int] = set()
        self._learnt: set[tuple[int, int]] = set()

    @property
    def descriptor(self) -> int:
        """File descriptor to poll for results."""
        return self._stdout.fileno()

    @property
    def has_room(self) -> bool:
        """True if the child may be given another episode."""
        return len(self.running) < EPISODES_PER_SLOT * max(1, self.begun)

    def slots(self, campaign: int) -> int:
        """Number of episodes of a campaign that the child runs side by side; 1 until it reports."""
        return self._slots.get(campaign, 1)

    def set_up(self, campaign: int, setup: EpisodeSetup) -> None:
        """Send the setup of a campaign, unless the child has it."""
        if campaign not in self._set_up:
            self._set_up.add(campaign)
            self.has_campaigns = True
            self._messages.put(messages.Setup(campaign, setup))

    def add_policy(self, campaign: int, policy: Policy) -> None:
        """Send a policy version of a campaign, unless the child has it."""
        if (campaign, policy.version) not in self._learnt:
            self._learnt.add((campaign, policy.version))
            self._messages.put(messages.PolicyUpdate(campaign, policy))

    def drop(self, campaign: int) -> None:
        """Let the child forget a campaign, after it has run the episodes that it holds."""
        self._set_up.discard(campaign)
        self.declined.pop(campaign, None)
        self._slots.pop(campaign, None)
        self._learnt = {key for key in self._learnt if key[0] != campaign}
        self.running = deque(held.without(campaign) for held in self.running)
        self._messages.put(messages.Drop(campaign))

    def run(self, held: HeldEpisode) -> None:
        """Send an episode. `listen` detects whether the child is alive."""
        if not self.running:
            self._progress_s = self._checked_s = time.monotonic()
        self.running.append(held)
        self._messages.put(messages.Lease(held.campaign, (held.task,)))

    def listen(self) -> tuple[bool, list[tuple[int, EpisodeResult]]]:
        """Return whether the child is sound, and the new results with their campaigns."""
        alive = self._buffer.read(self.descriptor)
        found: list[tuple[int, EpisodeResult]] = []
        try:
            found.extend(self._results())
        except ProtocolError:  # results that came before the invalid message stay
            return False, found
        return alive, found

    def _results(self) -> Iterator[tuple[int, EpisodeResult]]:
        for frame in self._buffer.frames():
            message = messages.read_worker_message(frame)
            self._progress_s = time.monotonic()
            self.ready = True
            if isinstance(message, messages.Heartbeat) and message.campaign is not None:
                self.begun += 1
                self._output.start_episode()
                self._slots[message.campaign] = message.slots
            if isinstance(message, messages.Heartbeat) and message.declined:
                self._decline(dict(message.declined))
            if isinstance(message, messages.Results):
                for result in message.results:
                    self._remove(message.campaign, result.index)
                    yield message.campaign, result

    def _decline(self, campaigns: dict[int, str]) -> None:
        """Remove all episodes of declined campaigns; no other episodes had begun."""
        self.declined |= campaigns
        self.running = deque(held for held in self.running if held.campaign not in campaigns)
        self.begun = 0

    def _remove(self, campaign: int, index: int) -> None:
        for place, held in enumerate(self.running):
            if (held.campaign, held.task.index) == (campaign, index):
                del self.running[place]
                self.begun = max(self.begun - 1, 0)
                return
        raise ProtocolError("The child sent a result that was not requested.")

    def is_overdue(self, limit_s: float) -> bool:
        """Return whether the running episode, or the loading of its parts, has taken too long.

        Call it continually: a pause between calls longer than STANDSTILL_S does not count, as the
        whole worker may have been stopped.
        """
        now_s, before_s = time.monotonic(), self._checked_s
        self._checked_s = now_s
        # The child may have been stopped with this process. A limit that went on would kill it for
        # that.
        if now_s - before_s > STANDSTILL_S:
            self._progress_s += now_s - before_s
        # Episodes side by side share the time of one process.
        limit_s = limit_s * self.begun if self.begun else START_LIMIT_S
        return bool(self.running) and now_s - self._progress_s > limit_s

    def find_excess(self) -> str:
        """Return the limit that the child exceeds, as the predicate of a sentence, or ""."""
        first = self.running[0] if self.running else None
        episode = (first.campaign, first.task.index) if first else None
        return self._monitor.find_excess(episode, max(1, self.begun))

    def memory_mib(self) -> float:
        """Resident memory of the child and its descendants. [MiB]"""
        return sum(map(resources.resident_mib, resources.list_process_tree(self._process.pid)))

    def finish(self) -> None:
        """Let the child end by itself after all messages; send nothing more after this."""
        self._messages.put(None)

    def has_ended(self) -> bool:
        """Return whether the process has exited, even if a descendant keeps its pipe open."""
        return processes.exit_status(self._process) is not None

    def end(self) -> int:
        """Kill the child and its descendants; return its exit status, or -signal."""
        if self._process.returncode is None:
            # To the guard, which kills every descendant; the group below is what a dead guard may
            # leave.
            os.kill(self._process.pid, signal.SIGTERM)
            processes.wait_for_exit(self._process, GUARD_S)
            processes.kill_group(self._process)
        self._messages.put(None)
        self._writer.join(JOIN_S)
        self._output.join(JOIN_S)
        self._stdout.close()
        return self._process.wait()


class NullChild(ChildProcess):
    """Replaces a child that could not be started, and ends after a second for another try.

    It never becomes ready, and takes no episode.
    """

    def __init__(self) -> None:
        self._start_records()
        self._until_s = time.monotonic() + RETRY_S

    @property
    def descriptor(self) -> int:
        """A descriptor that `poll` ignores."""
        return NO_DESCRIPTOR

    @property
    def has_room(self) -> bool:
        """Always False."""
        return False

    def drop(self, campaign: int) -> None:
        """Do nothing: no process holds a campaign."""

    def memory_mib(self) -> float:
        """Always 0. [MiB]"""
        return 0.0

    def finish(self) -> None:
        """Do nothing: no process could end."""

    def listen(self) -> tuple[bool, list[tuple[int, EpisodeResult]]]:
        """Return that the child is not sound, and no results."""
        return False, []

    def is_overdue(self, _limit_s: float) -> bool:
        """Always False: no episode runs."""
        return False

    def find_excess(self) -> str:
        """Return "": no process could exceed a limit."""
        return ""

    def has_ended(self) -> bool:
        """Return whether it is time to try to start another child."""
        return time.monotonic() >= self._until_s

    def end(self) -> int:
        """Return the exit status of a failure of the operating system."""
        return os.EX_OSERR


def _write_messages(pipe: BinaryIO, queue: "SimpleQueue[messages.Message | None]") -> None:
    """Write messages until None comes, or until the child has closed the pipe."""
    with contextlib.suppress(BrokenPipeError):
        while message := queue.get():
            write_message(pipe, message)
    with contextlib.suppress(BrokenPipeError):
        pipe.close()


def _start_child(limits: Limits) -> "subprocess.Popen[bytes]":
    """Start the child behind its guard, which takes over the exit status of the child."""
    try:
        return subprocess.Popen(
            [sys.executable, "-m", "eigenfail_workers.worker.child", str(limits.files)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=os.environ
            | processes.NUMERIC_ENVIRONMENT
            | processes.as_parent()
            | {EPISODE_VARIABLE: str(limits.episode_s)},
            start_new_session=True,
        )
    except OSError as error:
        raise _make_start_error(error) from error


def _make_start_error(error: Exception) -> ServiceError:
    return ServiceError(
        f"No inner process can be started here: {error}.",
        "End other programs, or run fewer workers on this machine.",
    )
