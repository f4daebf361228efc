"""A worker's connection to the hub: one DEALER socket, messages in and out."""

import contextlib
from collections.abc import Iterator

import zmq

from eigenfail.errors import InvalidValue, ProtocolError
from eigenfail.wire.messages import (
    MAX_MESSAGE_BYTES,
    HubMessage,
    Message,
    encode,
    read_hub_message,
)

LINGER_MS = 1_000
HIGH_WATER_MARK = 10_000


class Link:
    """Sends to the hub and hears from it; ZeroMQ reconnects by itself.

    Raises:
        InvalidValue: the address is none.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self.socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
        self.socket.setsockopt(zmq.LINGER, LINGER_MS)
        self.socket.setsockopt(zmq.SNDHWM, HIGH_WATER_MARK)
        self.socket.setsockopt(zmq.MAXMSGSIZE, MAX_MESSAGE_BYTES)
        try:
            self.socket.connect(address)
        except zmq.ZMQError as error:
            self.socket.close()
            problem = f"'{address}' cannot be connected to: {error}."
            raise InvalidValue("connect", problem, "Write it as tcp://host:port.") from error

    def send(self, message: Message) -> None:
        """Hand a message to ZeroMQ; dropped when the hub has been away for very long."""
        with contextlib.suppress(zmq.Again):
            self.socket.send(encode(message), zmq.NOBLOCK)

    def receive(self) -> Iterator[HubMessage]:
        """Every message that has come. What cannot be read is skipped: a lease expires instead."""
        while True:
            try:
                data = self.socket.recv(zmq.NOBLOCK)
            except zmq.Again:
                return
            with contextlib.suppress(ProtocolError):
                yield read_hub_message(data)  # type: ignore[misc]

    def close(self) -> None:
        """Send what is left, for at most a second, and disconnect."""
        self.socket.close()
