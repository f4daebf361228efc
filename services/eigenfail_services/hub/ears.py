"""Waits for whoever speaks first: the urgent ones at once, all others together."""

import time
from collections.abc import Sequence
from math import ceil

import zmq

APART_S = 0.025
"""From the end of one wait to the end of the next: whoever speaks meanwhile is heard in one go.

A turn of the hub costs as much for one word as for ten, and pushes an episode off its core.
"""

Sockets = Sequence["zmq.Socket[bytes]"]


class Ear:
    """A poller that is made anew only when others are to be heard."""

    def __init__(self) -> None:
        self._poller = zmq.Poller()
        self._sockets: Sockets = ()

    def hears(self, sockets: Sockets, ms: int) -> bool:
        """Whether one of them has something to read by then."""
        if sockets != self._sockets:
            self._sockets, self._poller = sockets, zmq.Poller()
            for socket in sockets:
                self._poller.register(socket, zmq.POLLIN)
        return bool(self._poller.poll(ms))


class Ears:
    """Of one thread."""

    def __init__(self) -> None:
        self._sharp, self._wide = Ear(), Ear()
        self._next_s = 0.0

    def wait(self, patient: Sockets, urgent: Sockets, ms: int) -> None:
        """Until one of them has something to read, but not for much longer than that."""
        apart_s = max(0.0, self._next_s - time.monotonic())
        if not self._speaks(urgent, apart_s):
            self._wide.hears([*patient, *urgent], ms)
        self._next_s = time.monotonic() + APART_S

    def _speaks(self, urgent: Sockets, apart_s: float) -> bool:
        if urgent:
            return self._sharp.hears(urgent, ceil(1_000 * apart_s))
        time.sleep(apart_s)  # a poller that has nobody to hear waits for nothing
        return False
