"""What the time of a running campaign goes into, measured where it is seen: in the hub."""

import time
from collections.abc import Callable
from enum import StrEnum
from threading import Lock

from eigenfail.values import Overhead


class Phase(StrEnum):
    """What a campaign is at: `simulating` as long as any episode is with a worker."""

    SIMULATING = "simulating"
    LEARNING = "learning"
    WAITING = "waiting"


class Meter:
    """Adds up the time between looks by what was seen at the earlier one.

    The hub looks, in its thread; the supervisor takes what has come together, in its own.

    Args:
        clock: seconds that only ever grow.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = Lock()
        self._phase: Phase | None = None
        self._since_s = 0.0
        self._spent_s = dict.fromkeys(Phase, 0.0)
        self._discarded_s = 0.0

    def look(self, phase: Phase | None) -> None:
        """From now on the campaign is at this; at nothing once the hub is done with it."""
        with self._lock:
            self._settle()
            self._phase = phase

    def discard(self, worker_s: float) -> None:
        """A result was thrown away that took a worker so long."""
        with self._lock:
            self._discarded_s += worker_s

    def take(self) -> Overhead:
        """What came together since it was last taken."""
        with self._lock:
            self._settle()
            taken = Overhead(
                self._spent_s[Phase.LEARNING], self._spent_s[Phase.WAITING], self._discarded_s
            )
            self._spent_s = dict.fromkeys(Phase, 0.0)
            self._discarded_s = 0.0
        return taken

    def give_back(self, taken: Overhead) -> None:
        """What was taken could not be kept: it is taken again the next time."""
        with self._lock:
            self._spent_s[Phase.LEARNING] += taken.learning_s
            self._spent_s[Phase.WAITING] += taken.waiting_s
            self._discarded_s += taken.discarded_s

    def _settle(self) -> None:
        now_s = self._clock()
        if self._phase is not None:
            self._spent_s[self._phase] += now_s - self._since_s
        self._since_s = now_s
