"""Clients that hang up before their request is complete."""

import socket
from collections.abc import Iterator
from contextlib import closing

import deadlines
import pytest
from served import serve
from started import wait_until

from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings

pytestmark = pytest.mark.service

HEALTH = b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n"
CHUNKED = (
    b"POST /api/v1/campaigns/check HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    b"Content-Type: application/json\r\nTransfer-Encoding: chunked\r\n\r\n"
)


@pytest.fixture
def port(store) -> Iterator[int]:
    with serve(create_app(store, ApiSettings(port=0))) as found:
        yield found


def connect(port: int, said: bytes) -> socket.socket:
    peer = socket.create_connection(("127.0.0.1", port), timeout=deadlines.PROCESS_S)
    peer.sendall(said)
    return peer


def heard(peer: socket.socket) -> bytes:
    """Everything that comes until the other side closes."""
    return b"".join(iter(lambda: peer.recv(65_536), b""))


def ask(port: int, path: bytes) -> bytes:
    with closing(connect(port, HEALTH.replace(b"/healthz", path))) as peer:
        return heard(peer)


@pytest.mark.fault(
    "client that hangs up in the middle of a body",
    group="api",
    outcome="The request ends; the log holds no traceback.",
)
@pytest.mark.parametrize("path", [b"/login", b"/api/v1/campaigns/check"])
def test_who_hangs_up_in_the_middle_of_a_body_leaves_no_traceback(port, path, caplog):
    half = CHUNKED.replace(b"/api/v1/campaigns/check", path) + b"5\r\n{"
    for _ in range(3):
        with closing(connect(port, half)) as peer:
            peer.shutdown(socket.SHUT_WR)
            assert heard(peer) == b""
    assert ask(port, b"/healthz").startswith(b"HTTP/1.1 200")
    # The peer sees its connection closed before the service has ended, and counted, the request.
    wait_until(lambda: b'status="499"} 3.0' in ask(port, b"/metrics"), "three requests are counted")
    assert [record for record in caplog.records if record.exc_info] == []
    assert b'status="5' not in ask(port, b"/metrics")
