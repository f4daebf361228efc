"""The place of a child that the system did not start, until it is time to try again."""

import os
import time
from collections import deque

from eigenfail.values import EpisodeResult
from eigenfail_workers.worker.child_process import ChildProcess, Held

AGAIN_AFTER_S = 1.0
NO_DESCRIPTOR = -1
"""`poll` passes over it."""


class Unborn(ChildProcess):
    """Takes no episode, says nothing, and ends after a second as one that was never ready."""

    def __init__(self) -> None:
        self.running: deque[Held] = deque()
        self.ready, self.begun = False, 0
        self._until_s = time.monotonic() + AGAIN_AFTER_S

    @property
    def descriptor(self) -> int:
        """None: there is nothing to wait for."""
        return NO_DESCRIPTOR

    @property
    def has_room(self) -> bool:
        """It has none."""
        return False

    def drop(self, campaign: int) -> None:
        """It was told of none."""

    def listen(self) -> tuple[bool, list[tuple[int, EpisodeResult]]]:
        """It does not live."""
        return False, []

    def overdue(self, _limit_s: float) -> bool:
        """It runs nothing."""
        return False

    def excess(self) -> str:
        """It takes nothing."""
        return ""

    def has_ended(self) -> bool:
        """Whether another one is to be tried."""
        return time.monotonic() >= self._until_s

    def end(self) -> int:
        """There is nothing to kill."""
        return os.EX_OSERR
