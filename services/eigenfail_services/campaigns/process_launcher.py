"""Workers as processes of this machine: as many as the work needs, started again when they die."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress

import structlog

from eigenfail.errors import ClusterUnavailable, Unauthorized
from eigenfail.hosting.service import Span
from eigenfail.processes import ONE_THREAD, as_parent, exit_status, kill_group
from eigenfail.wire.keys import WORKER_KEY_VARIABLE, WorkerKey
from eigenfail_services.campaigns import launcher
from eigenfail_services.campaigns.analysis_jobs import DATABASE_VARIABLE
from eigenfail_services.hub.transport import KEYS_VARIABLE

MODULE = "eigenfail_workers"

ASKED, REFUSED = "workers.asked", "workers.refused"

FIRST_PAUSE_S, LONGEST_PAUSE_S = 1.0, 30.0
"""Pauses before a worker that died is started again: twice as long each time, until a worker has
lasted that long. [s]"""

MOST_REFUSALS = 5
"""Exits with status 2 in a row after which a worker gives up: a key or an address is wrong. The
first one proves nothing, since a connection that is cut during its handshake looks like a refusal.
"""

GOODBYE_S = 3.0
"""Time for workers to end by themselves, once the hub has sent them home. [s]"""

ABSENT_S = 10.0
"""Time after which a worker that is not wanted and not connected is ended. [s]"""

LOOK_EVERY_S = 0.02

WITHHELD = frozenset({WORKER_KEY_VARIABLE, DATABASE_VARIABLE, KEYS_VARIABLE})
"""Variables of the services that their workers do not need, or would misunderstand: a worker's key
is that of another hub."""

log = structlog.get_logger()


class WorkerProcess:
    """A wanted worker, over all of its successive processes.

    Args:
        name: name of the worker.
        hub: address of the hub.
        key: the key that it presents to the hub, if the hub requires a key.

    Attributes:
        process: the present process; None before the first one and between two of them.
        has_given_up: whether its processes ended for a reason that lasts.
    """

    def __init__(self, name: str, hub: str, key: WorkerKey | None) -> None:
        self.name = name
        self.process: subprocess.Popen[bytes] | None = None
        self.has_given_up = False
        self._hub = hub
        self._key = key
        self._refusals = 0
        self._began_s = self._due_s = 0.0
        self._pause_s = FIRST_PAUSE_S
        self._absent_since_s: float | None = None

    @property
    def is_running(self) -> bool:
        """Return whether the worker has a process that lives."""
        return self.process is not None and exit_status(self.process) is None

    def start(self, now_s: float) -> None:
        """Start a process that leads a process group and dies with this process.

        Raises:
            OSError: the system lacks the resources for it.
        """
        command = [sys.executable, "-m", MODULE, "--connect", self._hub, "--name", self.name]
        if self._key is not None:
            # The key goes through standard input: other users of the machine can read command
            # lines.
            command += ["--key-file", "/dev/stdin"]
        environment = {n: v for n, v in os.environ.items() if n not in WITHHELD}
        # Standard output of the services is left to the line that names the hub's address, so
        # workers print to standard error. Each worker leads a group, so that what it starts ends
        # with it. What the operator sets overrides the number of threads.
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=sys.stderr.fileno(),
            env=ONE_THREAD | environment | as_parent(),
            process_group=0,
        )
        self._began_s = now_s
        if self.process.stdin is not None:
            # The process may have ended already, which `keep_running` notices.
            with suppress(OSError), self.process.stdin as stream:
                stream.write(self._key.text().encode() if self._key else b"")

    def keep_running(self, now_s: float) -> launcher.Notice | None:
        """Start another process once the last one has ended and its pause is over.

        Returns:
            A notice that the worker gives up or that a process cannot be started, or None.
        """
        if self.has_given_up or self.is_running:
            return None
        if self.process is not None:
            status = exit_status(self.process)
            # Processes that the dead worker has left behind end before another worker starts.
            self.end()
            return self._schedule(now_s, status)
        if now_s < self._due_s:
            return None
        try:
            self.start(now_s)
        except OSError as error:
            self._due_s = now_s + LONGEST_PAUSE_S
            problem = f"Worker {self.name} cannot be started: {error.strerror}."
            return launcher.Notice(
                ASKED, f"{problem} It is tried again every {LONGEST_PAUSE_S:.0f} s."
            )
        return None

    def leave(self, now_s: float, *, is_present: bool) -> None:
        """Ask an unwanted process to end if it has been absent from the hub for `ABSENT_S`.

        The hub itself dismisses the workers that are connected.
        """
        if is_present or self._absent_since_s is None:
            self._absent_since_s = None if is_present else now_s
        elif now_s - self._absent_since_s >= ABSENT_S:
            self.terminate()

    def terminate(self) -> None:
        """Send SIGTERM to its process: it hands over its results, and ends."""
        if self.process is not None and self.is_running:
            self.process.send_signal(signal.SIGTERM)

    def end(self) -> None:
        """Kill the process, and what the process started."""
        if self.process is not None:
            kill_group(self.process)
            self.process = None

    def _schedule(self, now_s: float, status: int | None) -> launcher.Notice | None:
        if now_s - self._began_s >= LONGEST_PAUSE_S:
            self._pause_s, self._refusals = FIRST_PAUSE_S, 0
        self._refusals = self._refusals + 1 if status == Unauthorized.exit_code else 0
        if self._refusals == MOST_REFUSALS:
            self.has_given_up = True
            remedy = "The log of the services says why; correct it and restart the services."
            return launcher.Notice(
                REFUSED, f"Worker {self.name} gave up after {MOST_REFUSALS} tries. {remedy}"
            )
        self._due_s = now_s + self._pause_s
        log.warning("worker ended", worker=self.name, status=status, again_in_s=self._pause_s)
        self._pause_s = min(2.0 * self._pause_s, LONGEST_PAUSE_S)
        return None


class ProcessLauncher:
    """Workers as child processes of the services.

    Args:
        span: minimum and maximum number of workers; equal bounds fix the number.
        clock: monotonic time. [s]
    """

    def __init__(self, span: Span, clock: Callable[[], float] = time.monotonic) -> None:
        self._span = span
        self._clock = clock
        self._wanted = launcher.WorkerNames(span)
        self._workers: dict[str, WorkerProcess] = {}
        self._hub = ""
        self._key: WorkerKey | None = None
        self._told: set[str] = set()

    def start(
        self, hub: str, key: WorkerKey | None = None, given_up: Callable[[], bool] = launcher.never
    ) -> None:
        """Start the minimum number of workers, without waiting for them.

        Raises:
            ClusterUnavailable: the system lacks the resources for their processes.
        """
        self._hub, self._key = hub, key
        if given_up():
            return
        self._add_new()
        try:
            for one in self._workers.values():
                one.start(self._clock())
        except OSError as error:
            raise ClusterUnavailable(
                f"A worker cannot be started: {error.strerror}.",
                "Free memory, or raise the limits of processes and open files (`ulimit -u -n`); or "
                "choose fewer workers: --workers.",
            ) from error

    def poll(self, table: launcher.WorkerPool) -> Sequence[launcher.Notice]:
        """Start, restart and dismiss workers to match the work."""
        now_s, demand = self._clock(), table.measure_demand()
        self._wanted.look(now_s, demand)
        unwanted = self._workers.keys() - set(self._wanted.names)
        table.drain_workers(unwanted)
        for name in unwanted:
            if self._workers[name].is_running:
                self._workers[name].leave(now_s, is_present=name in demand.present)
            else:
                self._workers.pop(name).end()
        self._add_new()
        wanted = [self._workers[name] for name in self._wanted.names]
        notices = [notice for one in wanted if (notice := one.keep_running(now_s))]
        if self._span.most == 0 and demand.work.episodes:
            notices.append(launcher.Notice(ASKED, launcher.NONE_MAY_START))
        # A worker that cannot be started fails again every 30 s: one event about it is enough.
        fresh = [one for one in notices if one.message not in self._told]
        self._told.update(one.message for one in fresh)
        return fresh

    def stop(self) -> None:
        """Wait a moment for the workers that the hub has dismissed, then end the rest."""
        # The hub has ended by now. Workers that received its goodbye leave by themselves, SIGTERM
        # is for the others, and the last ones are killed.
        _wait_for(self._workers.values(), GOODBYE_S)
        for one in self._workers.values():
            one.terminate()
        _wait_for(self._workers.values(), GOODBYE_S)
        for one in self._workers.values():
            one.end()
        self._workers.clear()

    def _add_new(self) -> None:
        for name in self._wanted.names:
            if name not in self._workers:
                self._workers[name] = WorkerProcess(name, self._hub, self._key)


def _wait_for(workers: Iterable[WorkerProcess], limit_s: float) -> None:
    until_s = time.monotonic() + limit_s
    while any(one.is_running for one in workers) and time.monotonic() < until_s:
        time.sleep(LOOK_EVERY_S)
