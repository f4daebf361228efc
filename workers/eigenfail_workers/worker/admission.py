"""Whether the hub lets this worker in: CURVE itself refuses without a word, for ever.

Told by what happens to the connection, as ZeroMQ's monitor reports it.
"""

import contextlib
import time
from collections.abc import Callable

import structlog
import zmq
from zmq.utils import z85
from zmq.utils.monitor import recv_monitor_message

from eigenfail.errors import ServiceUnreachable, Unauthorized
from eigenfail.wire.curve import HANDSHAKE_MS, WorkerKey

GIVE_UP_S = 30.0
"""How long whoever is there may break off one handshake after the other."""

LOOKED_FOR = (
    zmq.EVENT_HANDSHAKE_SUCCEEDED
    | zmq.EVENT_HANDSHAKE_FAILED_AUTH
    | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
    | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
    | zmq.EVENT_DISCONNECTED
    | zmq.EVENT_CLOSED
)

log = structlog.get_logger()


def show_key(socket: "zmq.Socket[bytes]", key: WorkerKey) -> None:
    """Have a socket, before it connects, show a worker's key and speak with that one hub alone."""
    socket.setsockopt(zmq.CURVE_SERVERKEY, key.hub)
    socket.setsockopt(zmq.CURVE_SECRETKEY, key.secret)
    socket.setsockopt(zmq.CURVE_PUBLICKEY, z85.decode(zmq.curve_public(z85.encode(key.secret))))


class Admission:
    """Watches the handshakes of a socket that does not connect yet.

    Args:
        address: of the hub.
        keyed: whether the socket shows a key.
    """

    def __init__(self, socket: "zmq.Socket[bytes]", address: str, keyed: bool) -> None:
        socket.setsockopt(zmq.HANDSHAKE_IVL, HANDSHAKE_MS)
        self._socket = socket
        self._events = socket.get_monitor_socket(LOOKED_FOR)
        self._address, self._keyed = address, keyed
        self._shaking = True
        self._known = False
        self._failing_since_s: float | None = None
        self._seeing: dict[int, Callable[[], None]] = {
            zmq.EVENT_HANDSHAKE_SUCCEEDED: self._let_in,
            zmq.EVENT_HANDSHAKE_FAILED_AUTH: self._refused,
            zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL: self._other_speech,
            zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL: self._broken_off,
            zmq.EVENT_DISCONNECTED: self._cut,
            zmq.EVENT_CLOSED: self._nobody_there,
        }

    def check(self) -> None:
        """Look at what happened since; never waits.

        Raises:
            Unauthorized: the hub refuses the key, or asks for one, or for none.
            ServiceUnreachable: whoever is there does not have the hub's key.
        """
        with contextlib.suppress(zmq.Again):
            while True:
                self._seeing[recv_monitor_message(self._events, zmq.NOBLOCK)["event"]]()
        since_s = self._failing_since_s
        if since_s is not None and time.monotonic() - since_s > GIVE_UP_S:
            self._failing_since_s = None
            self._despair()

    def close(self) -> None:
        """Stop watching, before the socket is closed."""
        self._socket.disable_monitor()
        self._events.close()

    def _let_in(self) -> None:
        self._shaking, self._known, self._failing_since_s = False, True, None

    def _refused(self) -> None:
        raise Unauthorized(
            f"The hub at {self._address} does not let in this worker's key.",
            "It may have been revoked: `eigenfail worker key list` tells, and `eigenfail worker "
            "key create` makes another.",
        )

    def _other_speech(self) -> None:
        """One shows a key where the other does not, or what was said was bent on its way."""
        if self._known:
            self._broken_off()
            return
        if self._keyed:
            problem = f"What listens at {self._address} is no hub that takes keys."
            raise Unauthorized(problem, "Is the address right? Was the hub started with its keys?")
        raise Unauthorized(
            f"The hub at {self._address} lets in only workers with a key.",
            "Name the file of one with --key-file; `eigenfail worker key create` makes it.",
        )

    def _broken_off(self) -> None:
        self._shaking = False
        if self._failing_since_s is None:
            self._failing_since_s = time.monotonic()
            log.warning("handshake broken off, trying again", hub=self._address)

    def _cut(self) -> None:
        if self._shaking:
            self._other_speech()
        self._shaking = True

    def _nobody_there(self) -> None:
        self._shaking, self._failing_since_s = True, None

    def _despair(self) -> None:
        """End, unless the hub was known: one with other keys looks like a tunnel to none at all."""
        if self._known:
            return
        question = (
            "Is the worker's key one of this hub's?"
            if self._keyed
            else "If it is a hub that asks for keys, name the file of one with --key-file."
        )
        raise ServiceUnreachable(
            f"What listens at {self._address} breaks off every handshake.",
            f"Is the address right? {question}",
        )
