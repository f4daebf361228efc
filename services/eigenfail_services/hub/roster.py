"""What the hub writes down about its workers: who is connected, and which campaigns lack one."""

import time
from collections.abc import Callable, Collection, Mapping

import structlog

from eigenfail_services.hub.worker_table import WorkerSession
from eigenfail_services.store.events import EventLog
from eigenfail_services.store.roster import Roster

ROSTER_INTERVAL_S = 1.0
HEARTBEAT_INTERVAL_S = 5.0

GRACE_PERIOD_S = 5.0
"""Time without a suitable worker before an event: workers connect a moment after their services
start, and again after their connections were cut."""

WORKERS_LACKING, WORKERS_MET = "workers.lacking", "workers.met"
NO_BRIDGE = (
    "No connected worker has a bridge: start one with `eigenfail worker --connect ADDRESS "
    "--bridge tcp://HOST:PORT`. Until then the campaign waits."
)
BRIDGE_CONNECTED = "A worker with a bridge is connected, and the campaign goes on."

log = structlog.get_logger()


class RosterWriter:
    """Writes arrivals and departures of workers, and at times that the others are still connected.

    Args:
        roster: is written to.
        sessions: of the connected workers, by connection.
    """

    def __init__(self, roster: Roster, sessions: Mapping[bytes, WorkerSession]) -> None:
        self._roster = roster
        self._sessions = sessions
        self._numbers: dict[WorkerSession, int] = {}
        self._next_update_s = self._next_heartbeat_s = time.monotonic()

    def update(self) -> None:
        """Write what has changed, if it is time to.

        Raises:
            StoreUnavailable: the next call tries again.
        """
        now_s = time.monotonic()
        if now_s < self._next_update_s:
            return
        arrived = [each for each in self._sessions.values() if each not in self._numbers]
        if arrived:
            numbers = self._roster.arrived([session.arrival for session in arrived])
            self._numbers.update(zip(arrived, numbers, strict=True))
        left = self._numbers.keys() - {*self._sessions.values()}
        if left:
            self._roster.left([self._numbers[session] for session in left])
            for session in left:
                del self._numbers[session]
        if now_s >= self._next_heartbeat_s and self._numbers:
            self._roster.heard(self._numbers.values())
            self._next_heartbeat_s = now_s + HEARTBEAT_INTERVAL_S
        self._next_update_s = now_s + ROSTER_INTERVAL_S

    def close(self) -> None:
        """Write that all workers have left.

        Raises:
            StoreUnavailable: it could not be written.
        """
        if self._numbers:
            self._roster.left(self._numbers.values())
        self._numbers.clear()


class UnrunnableCampaigns:
    """Writes an event for a campaign that no connected worker can run, and when one can again.

    Args:
        events: are written to.
        list_unrunnable: returns the campaigns with waiting episodes that no worker can run.
        has_bridge: returns whether a worker with a bridge is connected. Without waiting episodes, a
            campaign needs no worker, so only this tells that one has come.
    """

    def __init__(
        self,
        events: EventLog,
        list_unrunnable: Callable[[], Collection[int]],
        has_bridge: Callable[[], bool],
    ) -> None:
        self._events = events
        self._list_unrunnable = list_unrunnable
        self._has_bridge = has_bridge
        self._since_s: dict[int, float] = {}
        self._reported: set[int] = set()

    def update(self, running: Collection[int]) -> None:
        """Write the events that are due.

        Args:
            running: campaigns; nothing is written of others.

        Raises:
            StoreUnavailable: the next call tries again.
        """
        now_s, unrunnable = time.monotonic(), self._list_unrunnable()
        self._since_s = {each: self._since_s.get(each, now_s) for each in unrunnable}
        self._reported &= {*running}
        for campaign, since_s in self._since_s.items():
            if campaign not in self._reported and now_s - since_s >= GRACE_PERIOD_S:
                self._write(WORKERS_LACKING, NO_BRIDGE, campaign)
                self._reported.add(campaign)
        for campaign in self._reported.difference(unrunnable) if self._has_bridge() else ():
            self._write(WORKERS_MET, BRIDGE_CONNECTED, campaign)
            self._reported.remove(campaign)

    def _write(self, kind: str, message: str, campaign: int) -> None:
        self._events.append(kind, message, campaign)
        log.warning(message, kind=kind, campaign=campaign)
