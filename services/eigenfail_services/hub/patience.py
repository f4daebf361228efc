"""How long somebody may take over something."""

import time
from collections.abc import Callable

MOST_AT_A_LOOK_S = 1.0
"""Whoever did not look for longer stood still, or waited for the database: that is not counted."""


class Patience:
    """Counts the time between looks, until there has been too much of it.

    Args:
        limit_s: how long it lasts. [s]
        clock: seconds that only ever grow.
    """

    def __init__(self, limit_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._limit_s = limit_s
        self._clock = clock
        self.renew()

    def renew(self, pause_s: float = 0.0) -> None:
        """All of it is there again, from now on or after a pause."""
        self._spent_s = -pause_s
        self._looked_s = self._clock()

    def is_over(self) -> bool:
        """Look: whether it took longer."""
        now_s = self._clock()
        self._spent_s += min(now_s - self._looked_s, MOST_AT_A_LOOK_S)
        self._looked_s = now_s
        return self._spent_s > self._limit_s
