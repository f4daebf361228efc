"""Limits on requests: a rate for each caller, and a maximum of failed logins for each network.

Both keep a bounded table in memory: an attacker who changes addresses must not fill it.
"""

import logging
from collections import OrderedDict
from dataclasses import dataclass
from ipaddress import IPv6Address
from math import ceil
from threading import Lock

from fastapi import HTTPException

from eigenfail_api.access.proxy import parse_address

BURST_S = 5.0
"""Requests of this duration may come at once."""

MOST_CALLERS = 10_000

MOST_WRONG = 10
"""Failed logins with the id of one key, from one network."""

MOST_WRONG_IN_ALL = 50
"""Failed logins from one network: several people behind one address may each mistype a key."""

WITHIN_MS = 60_000
MOST_NETWORKS = 1_000
NETWORK_BITS = 64
"""Prefix of an IPv6 address that one customer of a provider has."""

ANY_KEY = None

log = logging.getLogger("eigenfail.access")


@dataclass
class _Bucket:
    tokens: float
    filled_ms: int


class RateLimiter:
    """A token bucket for each caller.

    Args:
        per_s: requests per second. [1/s]
        subject: subject of the sentence of a refusal, such as "This key".
    """

    def __init__(self, per_s: float, subject: str) -> None:
        self._per_s = per_s
        self._subject = subject
        self._lock = Lock()
        self._buckets: OrderedDict[int | str, _Bucket] = OrderedDict()

    def take(self, caller: int | str, at_ms: int) -> None:
        """Take a token for a request of a caller, who is named by a key's id or an address.

        Raises:
            HTTPException: 429, the bucket is empty; `Retry-After` says how long to wait.
        """
        with self._lock:
            bucket = self._fill(caller, at_ms)
            if bucket.tokens >= 1.0:
                bucket.tokens -= 1.0
                return
            wait_s = str(ceil((1.0 - bucket.tokens) / self._per_s))
        problem = f"{self._subject} sends more than {self._per_s:g} requests per second."
        raise HTTPException(429, problem, {"Retry-After": wait_s})

    def _fill(self, caller: int | str, at_ms: int) -> _Bucket:
        capacity = max(1.0, BURST_S * self._per_s)
        bucket = self._buckets.setdefault(caller, _Bucket(capacity, at_ms))
        # A wall clock that was set back must not empty the bucket.
        passed_s = max(0, at_ms - bucket.filled_ms) / 1_000.0
        bucket.tokens = min(capacity, bucket.tokens + passed_s * self._per_s)
        bucket.filled_ms = at_ms
        self._buckets.move_to_end(caller)
        if len(self._buckets) > MOST_CALLERS:
            self._buckets.popitem(last=False)
        return bucket


@dataclass
class _Failures:
    since_ms: int
    count: int = 0


class _FailureTable:
    """Number of failed logins within a minute by network and, unless `ANY_KEY`, by key."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._failures: OrderedDict[tuple[str, str | None], _Failures] = OrderedDict()

    def __len__(self) -> int:
        return len(self._failures)

    def count(self, network: str, key: str | None, at_ms: int) -> int:
        """Count a failure; return how many there were within the minute."""
        failures = self._failures.get((network, key))
        # A failure in the future was counted before the clock was set back.
        if failures is None or not 0 <= at_ms - failures.since_ms < WITHIN_MS:
            self._failures.pop((network, key), None)
            while len(self._failures) >= MOST_NETWORKS:
                self._failures.popitem(last=False)
            failures = self._failures[network, key] = _Failures(at_ms)
        failures.count += 1
        return failures.count

    def wait_ms(self, network: str, key: str | None, at_ms: int) -> int:
        """Return how long to wait after too many failures; 0 if there were not too many."""
        failures = self._failures.get((network, key))
        if failures is None or failures.count < self._most:
            return 0
        wait_ms = failures.since_ms + WITHIN_MS - at_ms
        if 0 < wait_ms <= WITHIN_MS:
            return wait_ms
        del self._failures[network, key]  # The minute has passed, or the clock was set back.
        return 0


class LoginThrottle:
    """Failed logins of the last minute, by the key that was tried and by network."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._by_key = _FailureTable(MOST_WRONG)
        self._by_network = _FailureTable(MOST_WRONG_IN_ALL)

    def refuse_too_many(self, address: str, key: str, at_ms: int) -> None:
        """Refuse a caller that sent too many wrong keys within the last minute.

        Args:
            address: address that sent the key.
            key: the id that the key names; empty if it names none.
            at_ms: milliseconds since 1970.

        Raises:
            HTTPException: 429; `Retry-After` says how long to wait.
        """
        network = network_of(address)
        with self._lock:
            wait_ms = max(
                self._by_key.wait_ms(network, key, at_ms),
                self._by_network.wait_ms(network, ANY_KEY, at_ms),
            )
        if wait_ms:
            wait_s = str(-(-wait_ms // 1_000))
            detail = "Too many failed login attempts from this address."
            raise HTTPException(429, detail, {"Retry-After": wait_s})

    def count_failure(self, address: str, key: str, at_ms: int) -> None:
        """Count a failed login; arguments as for `refuse_too_many`."""
        network = network_of(address)
        with self._lock:
            of_key = self._by_key.count(network, key, at_ms)
            in_all = self._by_network.count(network, ANY_KEY, at_ms)
        if of_key == MOST_WRONG or in_all == MOST_WRONG_IN_ALL:
            log.warning("%d wrong keys from %s within a minute", max(of_key, in_all), network)


def network_of(address: str) -> str:
    """Return the network whose failures are counted together; for IPv6, its first 64 bits."""
    parsed = parse_address(address)
    if not isinstance(parsed, IPv6Address):
        return address if parsed is None else str(parsed)
    host_bits = 128 - NETWORK_BITS
    return f"{IPv6Address(int(parsed) >> host_bits << host_bits)}/{NETWORK_BITS}"
