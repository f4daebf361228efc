"""Workers as processes of this machine: as many as the work needs, started again when they die."""

import os
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress

import structlog

from eigenfail.errors import ClusterUnavailable, Unauthorized
from eigenfail.hosting.service import Span
from eigenfail.processes import ONE_THREAD, as_parent, exit_status, kill_group
from eigenfail.wire.keys import WorkerKey
from eigenfail_services.campaigns.launcher import (
    Notice,
    WorkerNames,
    WorkerPool,
    describe_missing_workers,
    never,
)

MODULE = "eigenfail_workers"

ASKED, REFUSED = "workers.asked", "workers.refused"

FIRST_PAUSE_S, LONGEST_PAUSE_S = 1.0, 30.0
"""Before a worker that died is started again: twice as long each time, until one has lasted for as
long."""

MOST_REFUSALS = 5
"""Exits with status 2 after which a worker gives up: a key or an address is wrong. The first one
proves nothing, since a connection that is cut during its handshake looks like a refusal."""

GOODBYE_S = 3.0
"""Time for workers to end by themselves, once the hub has sent them home. [s]"""

LOOK_EVERY_S = 0.02

log = structlog.get_logger()


class WorkerProcess:
    """A worker that is to run, over all of its processes.

    Args:
        name: name of the worker.
        hub: address of the hub.
        key: what it shows there, if the hub asks for a key.

    Attributes:
        process: the present process, or the last one; None before the first.
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

    @property
    def is_running(self) -> bool:
        """Whether it has a process that lives."""
        return self.process is not None and exit_status(self.process) is None

    def start(self, now_s: float) -> None:
        """Start a process, as the leader of a group that dies with this process.

        Raises:
            OSError: the system has no room for it.
        """
        command = [sys.executable, "-m", MODULE, "--connect", self._hub, "--name", self.name]
        if self._key is not None:
            command += ["--key-file", "/dev/stdin"]
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=sys.stderr.fileno(),
            env=ONE_THREAD | os.environ | as_parent(),
            process_group=0,
        )
        self._began_s = now_s
        if self.process.stdin is not None:
            with suppress(OSError), self.process.stdin as stream:
                stream.write(self._key.text().encode() if self._key else b"")

    def restart(self, now_s: float) -> Notice | None:
        """Start another process once the last one has ended and its pause is over.

        Returns:
            Why it gives up, if it does.
        """
        if self.has_given_up or self.process is None or self.is_running:
            return None
        if not self._due_s:
            return self._schedule(now_s, exit_status(self.process))
        if now_s >= self._due_s:
            self._due_s = 0.0
            self.end()
            try:
                self.start(now_s)
            except OSError as error:
                log.warning("worker not started", worker=self.name, problem=str(error))
        return None

    def end(self) -> None:
        """Kill its process, and what that started."""
        if self.process is not None:
            kill_group(self.process)

    def _schedule(self, now_s: float, status: int | None) -> Notice | None:
        if status == Unauthorized.exit_code:
            self._refusals += 1
        if self._refusals == MOST_REFUSALS:
            self.has_given_up = True
            why = "The log of the services has its reason."
            return Notice(REFUSED, f"Worker {self.name} gave up after {MOST_REFUSALS} tries. {why}")
        if now_s - self._began_s >= LONGEST_PAUSE_S:
            self._pause_s = FIRST_PAUSE_S
        self._due_s = now_s + self._pause_s
        log.warning("worker ended", worker=self.name, status=status, again_in_s=self._pause_s)
        self._pause_s = min(2.0 * self._pause_s, LONGEST_PAUSE_S)
        return None


class ProcessLauncher:
    """Workers as child processes of the services.

    Args:
        span: between which numbers of workers; the same one twice is just that many.
        clock: seconds that only ever grow.
    """

    def __init__(self, span: Span, clock: Callable[[], float] = time.monotonic) -> None:
        self._span = span
        self._clock = clock
        self._wanted = WorkerNames(span)
        self._workers: dict[str, WorkerProcess] = {}
        self._hub = ""
        self._key: WorkerKey | None = None
        self._notices: deque[Notice] = deque()
        self._has_told_of_none = False

    def start(
        self, hub: str, key: WorkerKey | None = None, given_up: Callable[[], bool] = never
    ) -> None:
        """Start the workers that there are to be in any case, without waiting for them.

        Raises:
            ClusterUnavailable: the system has no room for their processes.
        """
        self._hub, self._key = hub, key
        if given_up():
            return
        try:
            self._add_new()
        except OSError as error:
            raise ClusterUnavailable(
                f"A worker cannot be started: {error.strerror}.",
                "Free memory, or raise the limits of processes and open files (`ulimit -u -n`); or "
                "choose fewer workers: --workers.",
            ) from error

    def poll(self, table: WorkerPool) -> Sequence[Notice]:
        """Start, restart and let go of workers by the work that there is."""
        now_s, demand = self._clock(), table.measure_demand()
        self._wanted.look(now_s, demand)
        table.drain_workers(self._workers.keys() - set(self._wanted.names))
        self._drop_unwanted()
        with suppress(OSError):  # no room now: tried again at the next turn
            self._add_new()
        self._notices += (
            notice for one in self._workers.values() if (notice := one.restart(now_s))
        )
        if self._span.most == 0 and demand.work.episodes and not self._has_told_of_none:
            self._has_told_of_none = True
            self._notices.append(Notice(ASKED, describe_missing_workers(demand.work.episodes)))
        notices = (*self._notices,)
        self._notices.clear()
        return notices

    def stop(self) -> None:
        """Wait a moment for the workers that the hub has sent home, then end the others."""
        _wait_for(self._workers.values(), GOODBYE_S)
        for one in self._workers.values():
            if one.process is not None and one.is_running:
                one.process.send_signal(signal.SIGTERM)
        _wait_for(self._workers.values(), GOODBYE_S)
        for one in self._workers.values():
            one.end()
        self._workers.clear()

    def _add_new(self) -> None:
        """Start the workers that are wanted and not there.

        Raises:
            OSError: the system has no room for one; the others are tried again.
        """
        for name in self._wanted.names:
            if name not in self._workers:
                worker = WorkerProcess(name, self._hub, self._key)
                worker.start(self._clock())
                self._workers[name] = worker

    def _drop_unwanted(self) -> None:
        """Forget unwanted workers that have left; the others work until they are sent home."""
        for name in self._workers.keys() - set(self._wanted.names):
            if not self._workers[name].is_running:
                self._workers.pop(name).end()


def _wait_for(workers: Iterable[WorkerProcess], limit_s: float) -> None:
    until_s = time.monotonic() + limit_s
    while any(one.is_running for one in workers) and time.monotonic() < until_s:
        time.sleep(LOOK_EVERY_S)
