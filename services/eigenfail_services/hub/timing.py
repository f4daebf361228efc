"""The time of running campaigns: what it is spent on, and timeouts."""

import time
from collections.abc import Callable
from enum import StrEnum
from threading import Lock

from eigenfail.values import Overhead

MAX_COUNTED_GAP_S = 1.0
"""Time between two looks that a timeout counts at most: a process that did not look for longer was
stopped, or waited for the database."""


class CampaignPhase(StrEnum):
    """What a campaign does: `simulating` as long as a worker holds any of its episodes."""

    SIMULATING = "simulating"
    LEARNING = "learning"
    WAITING = "waiting"


class TimeAccounting:
    """Adds up the time of a campaign by phase.

    The hub sets the phase in its thread; the supervisor takes the sums in another one.

    Args:
        clock: monotonic time. [s]
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = Lock()
        self._phase: CampaignPhase | None = None
        self._since_s = 0.0
        self._spent_s = dict.fromkeys(CampaignPhase, 0.0)
        self._discarded_s = 0.0

    def set_phase(self, phase: CampaignPhase | None) -> None:
        """Set the current phase; None when the hub is done with the campaign."""
        with self._lock:
            self._add_elapsed()
            self._phase = phase

    def add_discarded(self, worker_s: float) -> None:
        """Add the worker time of a result that was not kept. [s]"""
        with self._lock:
            self._discarded_s += worker_s

    def take(self) -> Overhead:
        """Return the sums since the last call, and begin new ones."""
        with self._lock:
            self._add_elapsed()
            taken = Overhead(
                self._spent_s[CampaignPhase.LEARNING],
                self._spent_s[CampaignPhase.WAITING],
                self._discarded_s,
            )
            self._spent_s = dict.fromkeys(CampaignPhase, 0.0)
            self._discarded_s = 0.0
        return taken

    def give_back(self, taken: Overhead) -> None:
        """Add sums that could not be stored, for the next call of `take`."""
        with self._lock:
            self._spent_s[CampaignPhase.LEARNING] += taken.learning_s
            self._spent_s[CampaignPhase.WAITING] += taken.waiting_s
            self._discarded_s += taken.discarded_s

    def _add_elapsed(self) -> None:
        now_s = self._clock()
        if self._phase is not None:
            self._spent_s[self._phase] += now_s - self._since_s
        self._since_s = now_s


class Timeout:
    """Expires after a time that counts only while this process runs.

    Args:
        limit_s: time until it expires. [s]
        clock: monotonic time. [s]
    """

    def __init__(self, limit_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._limit_s = limit_s
        self._clock = clock
        self.restart()

    def restart(self, pause_s: float = 0.0) -> None:
        """Begin to count anew, now or after a pause."""
        self._spent_s = -pause_s
        self._looked_s = self._clock()

    def has_expired(self) -> bool:
        """Count the time since the last look; return whether there has been too much of it."""
        now_s = self._clock()
        self._spent_s += min(now_s - self._looked_s, MAX_COUNTED_GAP_S)
        self._looked_s = now_s
        return self._spent_s > self._limit_s
