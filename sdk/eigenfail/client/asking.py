"""Questions that are asked again while a service is busy or away for a moment.

Whoever asks hears of the last try alone: those before it are told to the log, at debug.
"""

from collections.abc import Callable
from logging import getLogger
from random import uniform
from time import monotonic
from typing import TypeVar

import httpx2

from eigenfail.client.waiting import waiter

ATTEMPTS = 4
FIRST_PAUSE_S, JITTER_S = 0.1, 0.1
LONGEST_PAUSE_S = 30.0
"""How long a service may ask us to wait, and after how long nothing is asked again."""

BUSY = frozenset({429, 502, 503, 504})

Answer = TypeVar("Answer")

log = getLogger("eigenfail.client")


def ask_again(ask: Callable[[], Answer]) -> Answer:
    """The answer, after four tries at most; whatever the last one raises is raised."""
    begun_s = monotonic()
    for tried in range(1, ATTEMPTS):
        try:
            return ask()
        except httpx2.HTTPError as error:
            if not is_worth_retrying(error) or monotonic() - begun_s > LONGEST_PAUSE_S:
                raise
            pause_s = find_pause(error, tried)
            log.debug("try %d of %d failed, next in %.1f s: %s", tried, ATTEMPTS, pause_s, error)
        waiter.get().rest(pause_s)
    return ask()


def is_worth_retrying(error: httpx2.HTTPError) -> bool:
    """Whether the service was busy, or nothing came back."""
    if isinstance(error, httpx2.HTTPStatusError):
        return error.response.status_code in BUSY
    return isinstance(error, httpx2.TransportError)


def find_pause(error: httpx2.HTTPError, tried: int) -> float:
    """How long to wait: as the service says, or else longer after each try. [s]"""
    if isinstance(error, httpx2.HTTPStatusError):
        asked = error.response.headers.get("Retry-After", "")
        if asked.isdecimal():
            return min(float(asked), LONGEST_PAUSE_S)
    return FIRST_PAUSE_S * 2.0 ** (tried - 1) + uniform(0.0, JITTER_S)  # noqa: S311 - no secret
