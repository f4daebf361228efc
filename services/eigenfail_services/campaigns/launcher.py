"""Launchers of workers: their interface, and how their notices become events."""

import os
import platform
from collections import deque
from collections.abc import Callable, Collection, Sequence
from itertools import count
from math import ceil
from typing import Protocol

import msgspec
import structlog

from eigenfail.hosting.service import Span
from eigenfail.wire.keys import WorkerKey
from eigenfail_services.hub.metrics import Work, WorkerDemand
from eigenfail_services.store.events import EventLog


class Notice(msgspec.Struct, frozen=True):
    """A message about workers; becomes an event of this kind."""

    kind: str
    message: str


NONE_MAY_START = (
    "Episodes wait, and no worker may be started: the largest number of workers is 0. Restart the "
    "services with --workers or --max-workers, or start a worker by hand."
)


def never() -> bool:
    """Return False: the start is never given up."""
    return False


class WorkerPool(Protocol):
    """The part of the hub that launchers use."""

    def measure_demand(self) -> WorkerDemand:
        """Return the work that waits, and the connected workers."""

    def drain_workers(self, names: Collection[str]) -> None:
        """Lease nothing more to these workers, and end each once it holds no episode."""


class WorkerLauncher(Protocol):
    """Starts workers somewhere, and ends them."""

    def start(
        self, hub: str, key: WorkerKey | None = None, given_up: Callable[[], bool] = never
    ) -> None:
        """Start workers that connect to the hub, with a key if the hub requires one.

        Args:
            hub: its address.
            key: the key that workers present there.
            given_up: returns whether the caller has stopped waiting; then `start` returns without
                starting anything.

        Raises:
            ClusterUnavailable: there is nowhere to start them.
        """

    def poll(self, table: WorkerPool) -> Sequence[Notice]:
        """Adjust the number of workers without waiting; return the notices to report."""

    def stop(self) -> None:
        """Wait for the workers that are leaving, and end the others."""


class NoLauncher:
    """No launcher: workers are started by hand."""

    def start(
        self, hub: str, key: WorkerKey | None = None, given_up: Callable[[], bool] = never
    ) -> None:
        """Nothing to do."""

    def poll(self, _table: WorkerPool) -> Sequence[Notice]:
        """Return no notices."""
        return ()

    def stop(self) -> None:
        """Nothing to do."""


log = structlog.get_logger()


class WorkerScaling:
    """Lets a launcher adjust the number of workers, and stores its notices as events."""

    def __init__(self, launcher: WorkerLauncher, table: WorkerPool, events: EventLog) -> None:
        self._launcher = launcher
        self._table = table
        self._events = events
        self._unwritten: deque[Notice] = deque()

    def turn(self) -> None:
        """Adjust the number of workers and store new notices, without waiting.

        Raises:
            StoreUnavailable: the state could not be written; a later turn writes it.
        """
        for notice in self._launcher.poll(self._table):
            log.warning(notice.message, kind=notice.kind)
            self._unwritten.append(notice)
        while self._unwritten:
            # A notice leaves the queue after it was written: a database that is away delays events,
            # and none is lost.
            self._events.append(self._unwritten[0].kind, self._unwritten[0].message)
            self._unwritten.popleft()


WORK_EACH_S = 2.0
"""Work for each worker: with more workers it would not end noticeably sooner. [s]"""


RISE_AFTER_S = 2.0
"""A shorter need is over before a further worker has started. [s]"""


def count_needed(work: Work) -> int:
    """Return the number of workers that work needs: at least 1, at most 1 for each episode."""
    return min(work.episodes, max(1, ceil(work.worker_s / WORK_EACH_S)))


class _LastingChange:
    """The time for which another number of workers has been needed, and the smallest change in it.

    Args:
        lasts_s: how long a need must last to count. [s]
        nearest: returns whichever of two needs is nearer to the present number.
    """

    def __init__(self, lasts_s: float, nearest: Callable[[int, int], int]) -> None:
        self._lasts_s = lasts_s
        self._nearest = nearest
        self._began_s: float | None = None
        self._change = 0

    def over(self) -> None:
        """End the spell: the present number is enough."""
        self._began_s = None

    def go_on(self, now_s: float, need: int) -> int | None:
        """Return the number to change to, once another one has been needed for long enough."""
        if self._began_s is None:
            self._began_s, self._change = now_s, need
        # The smallest change that was needed all the time counts: a peak in between is over before
        # a worker has started.
        self._change = self._nearest(self._change, need)
        return self._change if now_s - self._began_s >= self._lasts_s else None


class WorkerScale:
    """Target number of workers: rises after two seconds of need, falls after `idle_s`.

    Whatever the work does, at least `idle_s` pass between a rise and the next fall, and two seconds
    between a fall and the next rise.

    Attributes:
        wanted: the target number.
    """

    def __init__(self, span: Span) -> None:
        self._span = span
        self.wanted = span.least
        self._more = _LastingChange(RISE_AFTER_S, min)
        self._fewer = _LastingChange(span.idle_s, max)

    def look(self, now_s: float, need: int) -> int:
        """Return the number of workers to have, from the number that is needed now.

        Args:
            now_s: time of a monotonic clock. [s]
            need: as `count_needed` returns it, less the workers that users start and stop.
        """
        within = min(max(need, self._span.least), self._span.most)
        for spell, applies in (
            (self._more, within > self.wanted),
            (self._fewer, within < self.wanted),
        ):
            if not applies:
                spell.over()
            elif (changed := spell.go_on(now_s, within)) is not None:
                self.wanted = changed
                self._more.over()
                self._fewer.over()
                break
        return self.wanted


def choose_surplus(
    names: Sequence[str], present: Collection[str], idle: Collection[str], n: int
) -> list[str]:
    """Return up to n workers to end, newest first: absent ones, then ones without an episode.

    A worker that holds an episode is never among them.
    """
    newest = names[::-1]
    # A worker that is not connected has no episode, so ending it costs nothing.
    absent = [name for name in newest if name not in present]
    return [*absent, *(name for name in newest if name in idle)][:n]


class WorkerNames:
    """The names of the workers that are to run, added and dropped with the demand.

    Attributes:
        names: the names, oldest first.
    """

    def __init__(self, span: Span) -> None:
        self._scale = WorkerScale(span)
        # No other service gives these names, on this machine or another one.
        self._new = (f"{platform.node()}-{os.getpid()}.{number}" for number in count())
        self.names: list[str] = []
        self._fill(span.least)

    def look(self, now_s: float, demand: WorkerDemand) -> None:
        """Add or drop names to match the demand; working workers are never dropped."""
        # Workers that users started by hand take part of the work.
        others = len(demand.present.difference(self.names))
        wanted = self._scale.look(now_s, count_needed(demand.work) - others)
        surplus = max(0, len(self.names) - wanted)
        gone = choose_surplus(self.names, demand.present, demand.idle, surplus)
        self.names = [name for name in self.names if name not in gone]
        self._fill(wanted)

    def _fill(self, n: int) -> None:
        self.names += (next(self._new) for _ in range(n - len(self.names)))
