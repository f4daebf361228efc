"""Whose connection is closed: found out by a word to those who were not heard of late.

The system of a process that was killed closes its connections at once, and ZeroMQ forgets them. Who
is slow or stopped keeps its own, and so does, for long, whose machine or network is gone.
"""

from collections.abc import Callable, Collection

QUIET_BEATS = 1.5
"""Who was not heard for so many heartbeats may be gone."""

LOOK_EVERY_S = 0.25

GRACE_S = 1.0
"""A worker whose line was cut is back by another one by then: it connects again within a fifth of a
second, is refused at its next heartbeat, and says hello at once."""


Reaches = Callable[[bytes], bool]
"""Whether a worker's connection is open."""


def everybody(_worker: bytes) -> bool:
    """Nobody's connection is known to be closed."""
    return True


class Lines:
    """Remembers since when connections are closed.

    Args:
        reaches: finds out by a word to the worker.
    """

    def __init__(self, reaches: Reaches) -> None:
        self._reaches = reaches
        self._closed_s: dict[bytes, float] = {}
        self._look_s = 0.0

    def closed(self, quiet: Collection[bytes], now_s: float) -> list[bytes]:
        """Those of the quiet ones whose connections have been closed for longer than the grace."""
        if now_s < self._look_s:
            return []
        self._look_s = now_s + LOOK_EVERY_S
        self._closed_s = {
            worker: self._closed_s.get(worker, now_s)
            for worker in quiet
            if worker in self._closed_s or not self._reaches(worker)
        }
        return [worker for worker, at_s in self._closed_s.items() if now_s - at_s >= GRACE_S]
