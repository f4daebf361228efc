"""Launchers of workers: what the services ask of them, and how their notices become events."""

from collections import deque
from collections.abc import Callable, Collection, Sequence
from typing import Protocol

import msgspec
import structlog

from eigenfail.wire.keys import WorkerKey
from eigenfail_services.hub.metrics import WorkerDemand
from eigenfail_services.store.events import EventLog


class Notice(msgspec.Struct, frozen=True):
    """A message about workers; becomes an event of this kind."""

    kind: str
    message: str


def never() -> bool:
    """Return False: the start is never given up."""
    return False


class WorkerPool(Protocol):
    """The hub, as far as launchers know it."""

    def measure_demand(self) -> WorkerDemand:
        """Return the work that waits, and the connected workers."""

    def drain_workers(self, names: Collection[str]) -> None:
        """Lease nothing more to these workers, and end each once it holds no episode."""


class WorkerLauncher(Protocol):
    """Starts workers somewhere, and ends them."""

    def start(
        self, hub: str, key: WorkerKey | None = None, given_up: Callable[[], bool] = never
    ) -> None:
        """Have workers connect to the hub, with a key where it asks for one.

        Args:
            hub: its address.
            key: what workers show there.
            given_up: whether nobody waits for it any more: then it returns, with nothing started.

        Raises:
            ClusterUnavailable: there is nowhere to start them.
        """

    def tend(self, table: WorkerPool) -> Sequence[Notice]:
        """Adjust the number of workers without waiting; return what is to be reported."""

    def stop(self) -> None:
        """Wait for the workers that are leaving, and end the others."""


class NoLauncher:
    """No launcher: workers are started by hand."""

    def start(
        self, hub: str, key: WorkerKey | None = None, given_up: Callable[[], bool] = never
    ) -> None:
        """Nothing to do."""

    def tend(self, _table: WorkerPool) -> Sequence[Notice]:
        """Return no notices."""
        return ()

    def stop(self) -> None:
        """Nothing to do."""


log = structlog.get_logger()


class WorkerScaling:
    """Has a launcher adjust the number of workers, and stores its notices as events."""

    def __init__(self, launcher: WorkerLauncher, table: WorkerPool, events: EventLog) -> None:
        self._launcher = launcher
        self._table = table
        self._events = events
        self._unwritten: deque[Notice] = deque()

    def turn(self) -> None:
        """Adjust the number of workers and store new notices, without waiting.

        Raises:
            StoreUnavailable: what is to be said could not be written down; a later turn does.
        """
        for notice in self._launcher.tend(self._table):
            log.warning(notice.message, kind=notice.kind)
            self._unwritten.append(notice)
        while self._unwritten:
            self._events.append(self._unwritten[0].kind, self._unwritten[0].message)
            self._unwritten.popleft()
