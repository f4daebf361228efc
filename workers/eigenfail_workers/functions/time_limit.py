"""A call that may not take for ever."""

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

SHORTEST_S = 1e-3


class TookTooLong(BaseException):
    """The call was broken off; no Exception, lest the call itself catches it and goes on."""


@contextmanager
def at_most(limit_s: float) -> Iterator[None]:
    """Break off what is inside after so many seconds, by the timer of the process.

    It breaks off Python, in the main thread. A call that stays in compiled code, or runs in another
    thread, is left alone: in a service the worker ends it with its process.

    Raises:
        TookTooLong: it was broken off.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    began_s = time.monotonic()
    handler = signal.signal(signal.SIGALRM, _ring)
    left_s, interval_s = signal.setitimer(signal.ITIMER_REAL, limit_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, handler)
        if left_s:  # somebody else's timer goes on
            left_s -= time.monotonic() - began_s
            signal.setitimer(signal.ITIMER_REAL, max(left_s, SHORTEST_S), interval_s)


def _ring(*_: object) -> None:
    raise TookTooLong
