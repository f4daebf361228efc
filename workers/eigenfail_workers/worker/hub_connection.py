"""The connection of a worker to the hub: one DEALER socket, and its handshakes."""

import contextlib
import time
from collections.abc import Callable, Iterator

import structlog
import zmq
from zmq.utils import z85
from zmq.utils.monitor import recv_monitor_message

from eigenfail.errors import InvalidValue, ProtocolError, ServiceUnreachable, Unauthorized
from eigenfail.wire import messages
from eigenfail.wire.keys import HANDSHAKE_MS, WorkerKey

GIVE_UP_S = 30.0
"""Time after which handshakes that are broken off again and again end the worker."""

HANDSHAKE_EVENTS = (
    zmq.EVENT_HANDSHAKE_SUCCEEDED
    | zmq.EVENT_HANDSHAKE_FAILED_AUTH
    | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
    | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
    | zmq.EVENT_DISCONNECTED
    | zmq.EVENT_CLOSED
)

LINGER_MS = 1_000
HIGH_WATER_MARK = 2 * messages.MAX_BYTES_TO_HUB // messages.PIECE_BYTES
"""Frames that may wait for the hub: room for the longest message in pieces, and for others."""
CHECK_EVERY_S = 0.1

log = structlog.get_logger()


class HandshakeMonitor:
    """Finds out whether the hub accepts this worker: CURVE refuses silently, and retries for ever.

    Args:
        socket: socket that is not connected yet.
        address: address of the hub.
        keyed: whether the socket presents a key.
    """

    def __init__(self, socket: "zmq.Socket[bytes]", address: str, keyed: bool) -> None:
        socket.setsockopt(zmq.HANDSHAKE_IVL, HANDSHAKE_MS)
        self._socket = socket
        self._events = socket.get_monitor_socket(HANDSHAKE_EVENTS)
        self._address, self._keyed = address, keyed
        self._in_handshake = True
        self._was_accepted = False
        self._failing_since_s: float | None = None
        self._handlers: dict[int, Callable[[], None]] = {
            zmq.EVENT_HANDSHAKE_SUCCEEDED: self._handle_success,
            zmq.EVENT_HANDSHAKE_FAILED_AUTH: self._handle_refusal,
            zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL: self._handle_mismatch,
            zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL: self._handle_break,
            zmq.EVENT_DISCONNECTED: self._handle_disconnection,
            zmq.EVENT_CLOSED: self._handle_no_listener,
        }

    def check(self) -> None:
        """Process the events since the last call, without waiting.

        Raises:
            Unauthorized: the hub refuses the key, or only one side uses keys.
            ServiceUnreachable: the program at the address does not have the key of the hub.
        """
        with contextlib.suppress(zmq.Again):
            while True:
                self._handlers[recv_monitor_message(self._events, zmq.NOBLOCK)["event"]]()
        since_s = self._failing_since_s
        # Not at the first one: a hub that is just stopped breaks off a handshake, too.
        if since_s is not None and time.monotonic() - since_s > GIVE_UP_S:
            self._failing_since_s = None
            self._give_up()

    def close(self) -> None:
        """Stop monitoring; call it before the socket is closed."""
        self._socket.disable_monitor()
        self._events.close()

    def _handle_success(self) -> None:
        self._in_handshake, self._was_accepted, self._failing_since_s = False, True, None

    def _handle_refusal(self) -> None:
        raise Unauthorized(
            f"The hub at {self._address} rejects this worker's key.",
            "It may have been revoked: `eigenfail worker key list` shows it, and `eigenfail worker "
            "key create` makes another.",
        )

    def _handle_mismatch(self) -> None:
        """Handle a mismatch: only one side presents a key, or bytes were changed on their way."""
        if self._was_accepted:
            self._handle_break()
            return
        if self._keyed:
            problem = f"What listens at {self._address} is no hub that takes keys."
            raise Unauthorized(problem, "Is the address right? Was the hub started with its keys?")
        raise Unauthorized(
            f"The hub at {self._address} lets in only workers with a key.",
            "Name the file of one with --key-file; `eigenfail worker key create` makes it.",
        )

    def _handle_break(self) -> None:
        self._in_handshake = False
        if self._failing_since_s is None:
            self._failing_since_s = time.monotonic()
            log.warning("handshake broken off, trying again", hub=self._address)

    def _handle_disconnection(self) -> None:
        if self._in_handshake:
            self._handle_mismatch()
        self._in_handshake = True

    def _handle_no_listener(self) -> None:
        self._in_handshake, self._failing_since_s = True, None

    def _give_up(self) -> None:
        """Raise, unless the hub has accepted this worker before.

        A hub with other keys cannot be distinguished from a tunnel without a hub behind it.
        """
        if self._was_accepted:
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


class HubConnection:
    """Sends and receives messages; ZeroMQ reconnects by itself.

    With a key the messages are encrypted by CURVE, and only the hub that the key names is accepted.

    Raises:
        InvalidValue: the address is not valid.
    """

    _next_check_s = 0.0

    def __init__(self, address: str, key: WorkerKey | None = None) -> None:
        self.address = address
        self.socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
        self.socket.setsockopt(zmq.LINGER, LINGER_MS)
        self.socket.setsockopt(zmq.SNDHWM, HIGH_WATER_MARK)
        self.socket.setsockopt(zmq.MAXMSGSIZE, messages.MAX_FRAME_BYTES)
        if key is not None:
            self.socket.setsockopt(zmq.CURVE_SERVERKEY, key.hub)
            self.socket.setsockopt(zmq.CURVE_SECRETKEY, key.secret)
            public = z85.decode(zmq.curve_public(z85.encode(key.secret)))
            self.socket.setsockopt(zmq.CURVE_PUBLICKEY, public)
        self._assembler = messages.Assembler()
        self.handshakes = HandshakeMonitor(self.socket, address, keyed=key is not None)
        try:
            self.socket.connect(address)
        except zmq.ZMQError as error:
            # Sockets that stay open would keep the process alive at its end.
            self.close()
            problem = f"'{address}' cannot be connected to: {error}."
            raise InvalidValue("connect", problem, "Write it as tcp://host:port.") from error

    def send(self, message: messages.Message) -> None:
        """Queue a message; it is dropped if the queue is full because the hub is away for long.

        Raises:
            ProtocolError: the message is longer than the hub accepts.
        """
        with contextlib.suppress(zmq.Again):
            for frame in messages.split(message, messages.MAX_BYTES_TO_HUB):
                self.socket.send(frame, zmq.NOBLOCK)

    def receive(self) -> Iterator[messages.HubMessage]:
        """Yield every message that has arrived, and the pieces of incomplete messages.

        A message that cannot be read is skipped: a lease in it expires.

        Raises:
            Unauthorized: the hub does not accept this worker.
            ServiceUnreachable: what listens at the address is not the hub.
        """
        if (now_s := time.monotonic()) >= self._next_check_s:
            # This is called in every turn of the loop; a refusal need not be noticed sooner.
            self._next_check_s = now_s + CHECK_EVERY_S
            self.handshakes.check()
        while True:
            try:
                data = self.socket.recv(zmq.NOBLOCK)
            except zmq.Again:
                return
            with contextlib.suppress(ProtocolError):
                yield self._read(data)

    def _read(self, data: bytes) -> messages.HubMessage:
        """Return the message in a frame, or the message that its piece completes."""
        message: messages.HubMessage = messages.read_hub_message(data)  # type: ignore[assignment]
        if (
            isinstance(message, messages.Piece)
            and (whole := self._assembler.add(message)) is not None
        ):
            return messages.read_hub_message(whole)  # type: ignore[return-value]
        return message

    def reconnect(self) -> None:
        """Replace a connection that failed without ZeroMQ noticing.

        ZeroMQ's own heartbeats cannot replace this: they may abort the process (4.3.5,
        `_io_error`).
        """
        with contextlib.suppress(zmq.ZMQError):  # ZeroMQ may have given it up already
            self.socket.disconnect(self.address)
        # The rest of a message that was cut off will not come on another connection.
        self._assembler.clear()
        self.socket.connect(self.address)

    def close(self) -> None:
        """Disconnect, after sending queued messages for at most a second."""
        self.handshakes.close()
        self.socket.close()
