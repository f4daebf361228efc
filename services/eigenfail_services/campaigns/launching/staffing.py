"""One turn after the other: as many workers as the work needs, and a word on what is in the way."""

from collections import deque

import structlog

from eigenfail.contracts import EventLog
from eigenfail_services.campaigns.launching.launcher import Launcher, Notice, Table

log = structlog.get_logger()


class Staffing:
    """Has a launcher look after a hub's workers, and writes down what it says."""

    def __init__(self, launcher: Launcher, table: Table, events: EventLog) -> None:
        self._launcher = launcher
        self._table = table
        self._events = events
        self._unwritten: deque[Notice] = deque()

    def turn(self) -> None:
        """Do what is to be done now; never waits.

        Raises:
            StoreUnavailable: what is to be said could not be written down; a later turn does.
        """
        for notice in self._launcher.tend(self._table):
            log.warning(notice.message, kind=notice.kind)
            self._unwritten.append(notice)
        while self._unwritten:
            self._events.append(self._unwritten[0].kind, self._unwritten[0].message)
            self._unwritten.popleft()
