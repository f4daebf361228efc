"""Waits for whoever speaks first; a poller is made anew only when others are to be heard."""

import time
from collections.abc import Sequence

import zmq

APART_S = 0.01
"""From the end of one wait to the end of the next: whoever speaks meanwhile is heard in one go."""


class Ears:
    """Of one thread."""

    def __init__(self) -> None:
        self._poller = zmq.Poller()
        self._sockets: Sequence[zmq.Socket[bytes]] = ()
        self._next_s = 0.0

    def wait(self, sockets: Sequence["zmq.Socket[bytes]"], ms: int) -> None:
        """Until one of them has something to read, but not for much longer than that."""
        time.sleep(max(0.0, self._next_s - time.monotonic()))
        if sockets != self._sockets:
            self._sockets, self._poller = sockets, zmq.Poller()
            for socket in sockets:
                self._poller.register(socket, zmq.POLLIN)
        self._poller.poll(ms)
        self._next_s = time.monotonic() + APART_S
