"""The hub's handle on a learner process."""

import contextlib
import os
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable

import structlog
import zmq

from eigenfail.errors import ProtocolError
from eigenfail.processes import ONE_THREAD, as_parent, exit_status, kill_group, status_within
from eigenfail.wire.messages import Message, Stop, Trouble, encode, read_learner_message
from eigenfail_services.bounds import NO_BOUNDS, Bounds
from eigenfail_services.hub.learner_curve import KEY_VARIABLE, lock
from eigenfail_services.hub.soundness import sound

STOP_S = 0.1

log = structlog.get_logger()


class LearnerLink:
    """One life of a learner process, and the socket to it.

    Args:
        bounds: of the process.
        pause_s: before it begins; commands wait for it. [s]
        clock: seconds that only ever grow.
    """

    def __init__(
        self,
        bounds: Bounds = NO_BOUNDS,
        pause_s: float = 0.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.PAIR)
        self._unsent: deque[bytes] = deque()
        self._bounds = bounds
        self._told = {KEY_VARIABLE: lock(self.socket)}
        self._address = f"tcp://127.0.0.1:{self.socket.bind_to_random_port('tcp://127.0.0.1')}"
        self._process: subprocess.Popen[bytes] | None = None
        self._clock = clock
        self._begins_s: float | None = clock() + pause_s
        self._begin_in_time()

    def _begin_in_time(self) -> None:
        if self._begins_s is None or self._clock() < self._begins_s:
            return
        self._begins_s = None
        self._process = start(self._address, self._told)
        if self._process is not None:
            self._bounds.confine(self._process.pid)

    def say(self, message: Message) -> None:
        """Send a command, now or as soon as the learner is there to take it."""
        self._unsent.append(encode(message))
        self._send()

    def _send(self) -> None:
        """Never waits: a PAIR without a peer would block the hub, for ever if the peer has died."""
        with contextlib.suppress(zmq.Again):
            while self._unsent:
                self.socket.send(self._unsent[0], zmq.NOBLOCK)
                self._unsent.popleft()

    def hear(self) -> Message | None:
        """What the learner said, if it said anything; what is no message is trouble too."""
        self._send()
        try:
            return sound(read_learner_message(self.socket.recv(zmq.NOBLOCK)))
        except zmq.Again:
            return None
        except ProtocolError as error:
            return Trouble(f"The learner cannot be understood: {error}")

    def exit_status(self) -> int | None:
        """None before it begins and while it lives; one that did not start has ended, too."""
        self._begin_in_time()
        if self._begins_s is not None:
            return None
        return os.EX_OSERR if self._process is None else exit_status(self._process)

    def stop(self) -> None:
        """End it: kindly if it listens, by force if it is busy learning what nobody needs.

        What it started goes with it, as far as it did not leave its group of processes; also if it
        has ended by itself.
        """
        if self._process is not None and exit_status(self._process) is None:
            self.say(Stop())
        self.socket.close(linger=100)
        if self._process is not None:
            status_within(self._process, STOP_S)
            kill_group(self._process)


def start(address: str, told: dict[str, str]) -> "subprocess.Popen[bytes] | None":
    """A learner process; None if the system has no room for one more, which may pass."""
    command = [sys.executable, "-m", "eigenfail_services.hub.learner_process", address]
    environment = os.environ | ONE_THREAD | as_parent() | told
    try:
        return subprocess.Popen(command, env=environment, process_group=0)
    except OSError as error:
        log.warning("learner not started", problem=str(error))
        return None
