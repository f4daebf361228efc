"""The hub's side of a learner process: starting it, talking to it, and restarting it."""

import contextlib
import os
import subprocess
import sys
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from enum import StrEnum
from math import isfinite

import msgspec
import numpy as np
import structlog
import zmq

from eigenfail import processes
from eigenfail.errors import ProtocolError
from eigenfail.values.episode import TrajectorySource
from eigenfail.values.estimates import Estimate
from eigenfail.values.learning import Policy
from eigenfail.wire import messages
from eigenfail_services.bounds import NO_BOUNDS, SettingBounds

STOP_S = 0.1
"""Time for a learner process to end by itself before it is killed."""

KEY_VARIABLE = "EIGENFAIL_LEARNER_KEY"
"""Environment variable with the hub's public key, which no other user of the machine can read."""

DIVERGENCE_REMEDY = (
    "Lower the method's learning rate, if it has one, and launch a copy of the campaign; of a "
    "method of your own, let it raise LearnerDiverged where that happens."
)

PAUSES_S = (0.0, 1.0, 5.0)
"""Pause before a restart, by the number of failures before it: memory and processes that a machine
ran out of are often available again soon."""

log = structlog.get_logger()


class FailureKind(StrEnum):
    """How a learner failed."""

    DIED = "died"
    DIVERGED = "diverged"
    HUNG = "hung"


# What a learner does follows from its checkpoint and the results. A NaN or a step without an end is
# tolerated once, in case a bit was flipped or two threads met; if it happens again from the same
# checkpoint, it would happen for ever. A death may be the machine's fault, and has one more try.
MAX_FAILURES = {FailureKind.DIED: 3, FailureKind.DIVERGED: 2, FailureKind.HUNG: 2}
"""Number of failures in a row, without a round learned in between, that end a campaign."""


class LearnerFailure(msgspec.Struct, frozen=True):
    """Why a learner is lost.

    Attributes:
        kind: kind of the failure.
        problem: what happened, in a sentence.
        remedy: what to do if it happens again.
    """

    kind: FailureKind
    problem: str
    remedy: str


def describe_exit(status: int) -> LearnerFailure:
    """Return the failure of a learner process that ended without a reason."""
    return LearnerFailure(
        FailureKind.DIED,
        f"The learner process died with exit status {status}.",
        "Its log says why, and memory is the usual reason; launch a copy of the campaign.",
    )


def describe_timeout(limit_s: float) -> LearnerFailure:
    """Return the failure of a learner whose step took longer than a limit."""
    return LearnerFailure(
        FailureKind.HUNG,
        f"The learner took more than {limit_s:g} s over one step, and was killed.",
        "If its settings ask for so much training, start the services with a larger "
        "--learner-limit; else correct the method. Then launch a copy of the campaign.",
    )


class LearnerRestarts:
    """Counts failures of a learner in a row, and decides whether it is restarted."""

    def __init__(self) -> None:
        self._counts = Counter[FailureKind]()

    def reset(self) -> None:
        """Start to count again, after a round was learned."""
        self._counts.clear()

    def add(self, failure: LearnerFailure) -> None:
        """Count a failure after which the learner is restarted."""
        self._counts[failure.kind] += 1

    @property
    def pause_s(self) -> float:
        """Pause before the next restart. [s]"""
        return PAUSES_S[min(self._counts.total(), len(PAUSES_S) - 1)]

    def explain_end(self, failure: LearnerFailure) -> str:
        """Return why this failure ends the campaign; empty if the learner may be restarted."""
        times = self._counts.total() + 1
        is_tolerated = self._counts[failure.kind] + 1 < MAX_FAILURES[failure.kind]
        if is_tolerated and times < max(MAX_FAILURES.values()):
            return ""
        again = f"The learner failed {times} times in a row from the same checkpoint."
        return f"{failure.problem} {again} {failure.remedy}".strip()


def encrypt_listener(socket: "zmq.Socket[bytes]") -> str:
    """Set up CURVE on a socket that is not bound yet; return the public key to connect with.

    Other users of the machine can reach a learner's port. CURVE does not answer anyone without the
    hub's public key, which is made for one learner process only.
    """
    public, secret = zmq.curve_keypair()
    socket.setsockopt(zmq.CURVE_SERVER, 1)
    socket.setsockopt(zmq.CURVE_SECRETKEY, secret)
    return public.decode()


def encrypt_caller(socket: "zmq.Socket[bytes]", key: str) -> None:
    """Set up CURVE on a socket that is not connected yet, with the public key of its peer."""
    public, secret = zmq.curve_keypair()
    socket.setsockopt(zmq.CURVE_SERVERKEY, key.encode())
    socket.setsockopt(zmq.CURVE_PUBLICKEY, public)
    socket.setsockopt(zmq.CURVE_SECRETKEY, secret)


class LearnerLink:
    """A learner process and the socket to it.

    Args:
        bounds: bounds of the process.
        pause_s: time before the process is started; messages wait for it. [s]
        clock: monotonic time. [s]
    """

    def __init__(
        self,
        bounds: SettingBounds = NO_BOUNDS,
        pause_s: float = 0.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.PAIR)
        self._unsent: deque[bytes] = deque()
        self._bounds = bounds
        self._environment = {KEY_VARIABLE: encrypt_listener(self.socket)}
        self._address = f"tcp://127.0.0.1:{self.socket.bind_to_random_port('tcp://127.0.0.1')}"
        self._process: subprocess.Popen[bytes] | None = None
        self._clock = clock
        self._start_at_s: float | None = clock() + pause_s
        self._start_when_due()

    def _start_when_due(self) -> None:
        if self._start_at_s is None or self._clock() < self._start_at_s:
            return
        self._start_at_s = None
        command = [sys.executable, "-m", "eigenfail_services.hub.learner_process", self._address]
        environment = (
            os.environ | processes.NUMERIC_ENVIRONMENT | processes.as_parent() | self._environment
        )
        try:
            self._process = subprocess.Popen(command, env=environment, process_group=0)
        except OSError as error:  # no room for one more process, which may pass
            log.warning("learner not started", problem=str(error))
        else:
            self._bounds.confine(self._process.pid)

    def send(self, message: messages.Message) -> None:
        """Send a message, now or as soon as the learner can take it."""
        self._unsent.append(messages.encode(message))
        self._send_waiting()

    def _send_waiting(self) -> None:
        # Without NOBLOCK a PAIR without a peer would block the hub, for ever if the peer has died.
        with contextlib.suppress(zmq.Again):
            while self._unsent:
                self.socket.send(self._unsent[0], zmq.NOBLOCK)
                self._unsent.popleft()

    def receive(self) -> messages.Message | None:
        """Return the learner's next message or None; malformed bytes become `Trouble`."""
        self._send_waiting()
        try:
            return check_numbers(messages.read_learner_message(self.socket.recv(zmq.NOBLOCK)))
        except zmq.Again:
            return None
        except ProtocolError as error:
            return messages.Trouble(f"The learner cannot be understood: {error}")

    def exit_status(self) -> int | None:
        """Return the exit status of a process that has ended or could not be started.

        Returns:
            None before the process is started and while it runs.
        """
        self._start_when_due()
        if self._start_at_s is not None:
            return None
        return os.EX_OSERR if self._process is None else processes.exit_status(self._process)

    def stop(self) -> None:
        """End the learner: on request if it listens, by force if it is busy.

        All processes of its group end with it, also if the learner has ended by itself.
        """
        if self._process is not None and processes.exit_status(self._process) is None:
            self.send(messages.Stop())
        # The request to stop still leaves within this time. [ms]
        self.socket.close(linger=100)
        if self._process is not None:
            processes.wait_for_exit(self._process, STOP_S)
            processes.kill_group(self._process)


def check_numbers(message: messages.Message) -> messages.Message:
    """Return a learner's message, or a divergence in its place if it holds NaN or infinity.

    No worker could use such a policy, and no page could show such an estimate.
    """
    if isinstance(message, messages.Proposed):
        # The first one is enough: the whole proposal is refused.
        for place in _find_non_finite(message):
            return messages.Diverged(
                f"{place} holds a number that is NaN or infinite.", DIVERGENCE_REMEDY
            )
    return message


def _find_non_finite(message: messages.Proposed) -> Iterator[str]:
    for opened in message.rounds:
        if opened.policy is not None and not _is_finite_policy(opened.policy):
            yield f"Policy {opened.policy.version}, which the learner proposed,"
        for task in opened.tasks:
            if isinstance(task.source, TrajectorySource) and not np.isfinite(task.source.z).all():
                yield f"The noise that the learner proposed for episode {task.index}"
    if message.estimate is not None and not _is_finite_estimate(message.estimate):
        yield "The learner's estimate of the failure probability"


def _is_finite_policy(policy: Policy) -> bool:
    layers = (*policy.hidden, policy.mean, policy.log_std)
    parts = (part for layer in layers for part in (layer.weight, layer.bias))
    return isfinite(policy.amplitude) and all(np.isfinite(part).all() for part in parts)


def _is_finite_estimate(estimate: Estimate) -> bool:
    interval = estimate.interval
    ends = [] if interval is None else list(msgspec.structs.astuple(interval))
    numbers = [estimate.probability, estimate.cv, estimate.effective, *ends]
    return all(number is None or isfinite(number) for number in numbers)
