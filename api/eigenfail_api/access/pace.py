"""How many requests somebody may send: so many a second, and those of a few seconds at once."""

from collections import OrderedDict
from dataclasses import dataclass
from math import ceil
from threading import Lock

from fastapi import HTTPException

BURST_S = 5.0
MOST_KNOWN = 10_000


@dataclass
class Bucket:
    """What a caller has left, as of a moment."""

    left: float
    at_ms: int


class Pace:
    """A bucket of requests for each caller, which fills as time goes by.

    Args:
        per_s: requests a second. [1/s]
        who: what a caller is, as a refusal tells it.
    """

    def __init__(self, per_s: float, who: str) -> None:
        self._per_s = per_s
        self._who = who
        self._lock = Lock()
        self._buckets: OrderedDict[int | str, Bucket] = OrderedDict()

    def take(self, caller: int | str, at_ms: int) -> None:
        """One request of a caller: by the id of a key, or by an address.

        Raises:
            HTTPException: 429, there were too many lately, with the time to wait.
        """
        with self._lock:
            bucket = self._filled(caller, at_ms)
            if bucket.left >= 1.0:
                bucket.left -= 1.0
                return
            wait_s = str(ceil((1.0 - bucket.left) / self._per_s))
        problem = f"{self._who} sends more than {self._per_s:g} requests a second."
        raise HTTPException(429, problem, {"Retry-After": wait_s})

    def _filled(self, caller: int | str, at_ms: int) -> Bucket:
        most = max(1.0, BURST_S * self._per_s)
        bucket = self._buckets.setdefault(caller, Bucket(most, at_ms))
        passed_s = max(0, at_ms - bucket.at_ms) / 1_000.0
        bucket.left = min(most, bucket.left + passed_s * self._per_s)
        bucket.at_ms = at_ms
        self._buckets.move_to_end(caller)
        if len(self._buckets) > MOST_KNOWN:
            self._buckets.popitem(last=False)
        return bucket
