"""Whoever listens at an address and speaks first speaks no HTTP: ZeroMQ does, at a hub's port.

Its first byte ends no line, so that a client of HTTP would wait for the rest of it.
"""

import socket
from contextlib import suppress
from typing import Any

import httpx2

from eigenfail.errors import ServiceUnreachable

LISTEN_S = 3.0
ZEROMQ = b"\xff"


def listen_first(request: httpx2.Request) -> None:
    """Have the first byte of each new connection looked at, as soon as it comes."""
    request.extensions = {**request.extensions, "trace": FirstByte(request.url)}


class FirstByte:
    """Told of a request's steps by the transport.

    Args:
        url: of the request.
    """

    def __init__(self, url: httpx2.URL) -> None:
        self._url = url
        self._new: socket.socket | None = None

    def __call__(self, step: str, info: dict[str, Any]) -> None:
        """Look, once a request was sent over a new connection.

        Raises:
            ServiceUnreachable: it is a hub that is there.
        """
        if step == "connection.connect_tcp.complete":
            self._new = info["return_value"].get_extra_info("socket")
        elif step == "http11.receive_response_headers.started" and self._new is not None:
            if first_byte(self._new) == ZEROMQ:
                raise self._no_http()
            self._new = None

    def _no_http(self) -> ServiceUnreachable:
        return ServiceUnreachable(
            f"What listens at {self._url.netloc.decode()} speaks ZeroMQ, as a hub does to workers.",
            "Give the address of the service itself, http://…; `eigenfail up` prints both.",
        )


def first_byte(connection: socket.socket) -> bytes:
    """What comes first, left where it is; nothing if it takes long, or the connection ended."""
    with suppress(OSError):
        connection.settimeout(LISTEN_S)
        return connection.recv(1, socket.MSG_PEEK)
    return b""
