"""Ctrl-C, SIGTERM and a closed terminal mean the same: stop what was started, then end."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def handled(handler: Callable[..., Any]) -> Iterator[None]:
    """These signals go to one handler for a while; only the main thread can hear them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, handler) for number in STOP_SIGNALS}
    try:
        yield
    finally:
        for number, previous in before.items():
            signal.signal(number, previous)


def interrupt(*_: object) -> None:
    """What Python does on Ctrl-C."""
    raise KeyboardInterrupt


def interruptible() -> Any:
    """Each of these signals raises KeyboardInterrupt."""
    return handled(interrupt)
