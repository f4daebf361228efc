"""What goes from the hub to its workers: at once, or never."""

from typing import Any

import zmq

from eigenfail.wire.messages import Ack, Message, encode

HEARD = Ack(0, ())
"""The answer to a heartbeat, and a word to those who say nothing."""

UNSENT = frozenset({zmq.EAGAIN, zmq.EHOSTUNREACH})


class Post:
    """Hands messages to a ROUTER that tells who is not connected (ZMQ_ROUTER_MANDATORY)."""

    def __init__(self, router: Any) -> None:
        self._router = router

    def send(self, worker: bytes, message: Message) -> None:
        """A message; dropped if its worker takes none for long, or has no connection."""
        self._put(worker, message)

    def reaches(self, worker: bytes) -> bool:
        """Whether a worker's connection is open, as that of a slow or a stopped one is."""
        return self._put(worker, HEARD) != zmq.EHOSTUNREACH

    def _put(self, worker: bytes, message: Message) -> int:
        """Why it was not sent; 0 if it was."""
        try:
            self._router.send_multipart([worker, encode(message)], zmq.NOBLOCK)
        except zmq.ZMQError as error:
            if error.errno not in UNSENT:
                raise
            return error.errno
        return 0
