"""Says of campaigns that wait that nobody who is here can run them, and when somebody can."""

import time
from collections.abc import Callable, Collection

import structlog

from eigenfail.contracts import EventLog

PATIENCE_S = 5.0
"""Workers come a moment after their services, and after a line that was cut."""

LACKING, MET = "workers.lacking", "workers.met"
NO_BRIDGE = (
    "No connected worker has a bridge: start one with `eigenfail worker --connect ADDRESS "
    "--bridge tcp://HOST:PORT`. Until then the campaign waits."
)
A_BRIDGE = "A worker with a bridge is connected, and the campaign goes on."

log = structlog.get_logger()


class Stranded:
    """Writes an event when it has lasted, and another one when it is over.

    Args:
        events: where it is said.
        look: which campaigns they are.
        has_bridge: whether anybody who is here has one; where nothing waits, nobody is looked for.
    """

    def __init__(
        self,
        events: EventLog,
        look: Callable[[], Collection[int]],
        has_bridge: Callable[[], bool],
    ) -> None:
        self._events = events
        self._look = look
        self._has_bridge = has_bridge
        self._since_s: dict[int, float] = {}
        self._told: set[int] = set()

    def note(self, running: Collection[int]) -> None:
        """Look, and say what is new of the campaigns that run.

        Raises:
            StoreUnavailable: it could not be written down; the next call goes on with it.
        """
        now_s, stranded = time.monotonic(), self._look()
        self._since_s = {each: self._since_s.get(each, now_s) for each in stranded}
        self._told &= {*running}
        for campaign, since_s in self._since_s.items():
            if campaign not in self._told and now_s - since_s >= PATIENCE_S:
                self._say(LACKING, NO_BRIDGE, campaign)
                self._told.add(campaign)
        for campaign in self._told.difference(stranded) if self._has_bridge() else ():
            self._say(MET, A_BRIDGE, campaign)
            self._told.remove(campaign)

    def _say(self, kind: str, message: str, campaign: int) -> None:
        self._events.append(kind, message, campaign)
        log.warning(message, kind=kind, campaign=campaign)
