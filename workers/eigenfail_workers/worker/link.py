"""A worker's connection to the hub: one DEALER socket, messages in and out."""

import contextlib
import time
from collections.abc import Iterator

import zmq

from eigenfail.errors import InvalidValue, ProtocolError
from eigenfail.wire.curve import WorkerKey
from eigenfail.wire.messages import (
    MAX_MESSAGE_BYTES,
    HubMessage,
    Message,
    encode,
    read_hub_message,
)
from eigenfail_workers.worker.admission import Admission, show_key

LINGER_MS = 1_000
HIGH_WATER_MARK = 10_000
LOOK_EVERY_S = 0.1
"""Between two looks at how the handshakes went."""


class Link:
    """Sends to the hub and hears from it; ZeroMQ reconnects by itself.

    With a key it speaks over CURVE with the one hub that the key names, and with nobody else.

    Raises:
        InvalidValue: the address is none.
    """

    _look_s = 0.0

    def __init__(self, address: str, key: WorkerKey | None = None) -> None:
        self.address = address
        self.socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
        self.socket.setsockopt(zmq.LINGER, LINGER_MS)
        self.socket.setsockopt(zmq.SNDHWM, HIGH_WATER_MARK)
        self.socket.setsockopt(zmq.MAXMSGSIZE, MAX_MESSAGE_BYTES)
        if key is not None:
            show_key(self.socket, key)
        self.admission = Admission(self.socket, address, keyed=key is not None)
        try:
            self.socket.connect(address)
        except zmq.ZMQError as error:
            self.close()
            problem = f"'{address}' cannot be connected to: {error}."
            raise InvalidValue("connect", problem, "Write it as tcp://host:port.") from error

    def send(self, message: Message) -> None:
        """Hand a message to ZeroMQ; dropped when the hub has been away for very long."""
        with contextlib.suppress(zmq.Again):
            self.socket.send(encode(message), zmq.NOBLOCK)

    def receive(self) -> Iterator[HubMessage]:
        """Every message that has come. What cannot be read is skipped: a lease expires instead.

        Raises:
            Unauthorized: the hub does not let this worker in.
            ServiceUnreachable: whoever is there is not the hub.
        """
        if (now_s := time.monotonic()) >= self._look_s:
            self._look_s = now_s + LOOK_EVERY_S
            self.admission.check()
        while True:
            try:
                data = self.socket.recv(zmq.NOBLOCK)
            except zmq.Again:
                return
            with contextlib.suppress(ProtocolError):
                yield read_hub_message(data)  # type: ignore[misc]

    def connect_again(self) -> None:
        """Give up a line that is dead or spoilt, of which ZeroMQ does not know, or let it be.

        ZeroMQ's own heartbeats are no help: they can end the whole process (4.3.5, `_io_error`).
        """
        with contextlib.suppress(zmq.ZMQError):  # it may have been given up already
            self.socket.disconnect(self.address)
        self.socket.connect(self.address)

    def close(self) -> None:
        """Send what is left, for at most a second, and disconnect."""
        self.admission.close()
        self.socket.close()
