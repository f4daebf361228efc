"""Wrong keys are counted: who shows too many of them has to wait."""

import logging
from dataclasses import dataclass
from threading import Lock

from fastapi import HTTPException

MOST_WRONG = 10
WITHIN_MS = 60_000
MOST_KNOWN = 1_000

log = logging.getLogger("eigenfail.access")


@dataclass
class Wrong:
    """How many wrong keys were shown since a moment."""

    since_ms: int
    count: int = 0


class Attempts:
    """Wrong keys by the address they came from and the key they were to be."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._wrong: dict[tuple[str, str], Wrong] = {}

    def refuse_too_many(self, address: str, key: str, at_ms: int) -> None:
        """Whoever showed too many wrong ones lately.

        Raises:
            HTTPException: 429, with the time to wait.
        """
        with self._lock:
            wrong = self._wrong.get((address, key))
            if wrong is None or wrong.count < MOST_WRONG:
                return
            left_ms = wrong.since_ms + WITHIN_MS - at_ms
            if not 0 < left_ms <= WITHIN_MS:  # it is over, or the clock was set back
                del self._wrong[address, key]
                return
        wait_s = str(-(-left_ms // 1_000))
        raise HTTPException(429, "Too many wrong keys came from there.", {"Retry-After": wait_s})

    def note_wrong(self, address: str, key: str, at_ms: int) -> None:
        """One more."""
        with self._lock:
            wrong = self._wrong.get((address, key))
            if wrong is None or not 0 <= at_ms - wrong.since_ms < WITHIN_MS:
                self._wrong.pop((address, key), None)
                while len(self._wrong) >= MOST_KNOWN:
                    del self._wrong[next(iter(self._wrong))]
                wrong = self._wrong[address, key] = Wrong(at_ms)
            wrong.count += 1
        if wrong.count == MOST_WRONG:
            log.warning("%d wrong keys from %s within a minute", MOST_WRONG, address)
