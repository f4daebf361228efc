"""Connections of those who say too little, too slowly or in crumbs; and requests of two lengths."""

import json
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, suppress
from threading import Event, Thread

import deadlines
import pytest
from started import wait_until

from eigenfail_api import connections
from eigenfail_api.__main__ import Server, listen
from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings

pytestmark = pytest.mark.service

MOST = 40
PATIENCE_S = deadlines.PROCESS_S
SHORT_S = 0.6
BODY = b'{"name": "n", "method": "monte_carlo", "episodes": 5}'
POST = (
    b"POST /api/v1/campaigns/check HTTP/1.1\r\n"
    b"Host: 127.0.0.1\r\nContent-Type: application/json\r\n"
)
CHUNKED = POST + b"Transfer-Encoding: chunked\r\n\r\n"
HEALTH = b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n"


@pytest.fixture
def port(store) -> Iterator[int]:
    """Of a server that takes few connections."""
    server = Server(create_app(store, ApiSettings(port=0, max_connections=MOST)))
    with listen("127.0.0.1", 0) as listener:
        thread = Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        yield listener.getsockname()[1]
        server.should_exit = True
        thread.join()


@pytest.fixture
def hurried(monkeypatch, port):
    """The same, with time-outs that a test can wait for."""
    for name in ("HEAD_S", "BODY_S", "DRAIN_S"):
        monkeypatch.setattr(connections, name, SHORT_S)
    return port


def connect(port: int, said: bytes = b"") -> socket.socket:
    peer = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
    peer.sendall(said)
    return peer


def heard(peer: socket.socket) -> bytes:
    """Everything that comes until the other side closes."""
    said = bytearray()
    try:
        while data := peer.recv(65536):
            said += data
    except ConnectionError:
        pass
    return bytes(said)


def asked(port: int, said: bytes) -> tuple[int, dict]:
    """Status and problem of an answer."""
    with closing(connect(port, said)) as peer:
        head, _, body = heard(peer).partition(b"\r\n\r\n")
    assert b"connection: close" in head.lower()
    return int(head.split()[1]), json.loads(body)


def is_well(port: int) -> bool:
    with closing(connect(port, HEALTH)) as peer:
        return heard(peer).startswith(b"HTTP/1.1 200")


@pytest.mark.fault(
    "request with two lengths",
    group="api",
    outcome="It is refused with 400, and its connection is closed.",
)
@pytest.mark.parametrize(
    "headers",
    [
        b"Content-Length: 5\r\nTransfer-Encoding: chunked\r\n",
        b"Transfer-Encoding: chunked\r\nContent-Length: 5\r\n",
        b"Content-Length: 5\r\nContent-Length: 6\r\n",
        b"Content-Length: 5, 6\r\n",
        b"Transfer-Encoding: chunked\r\nTransfer-Encoding: chunked\r\n",
        b"Transfer-Encoding: identity, chunked\r\n",
        b"Transfer-Encoding : chunked\r\n",
        b"Content-Length: +5\r\n",
        b"Content-Length: 0x5\r\n",
    ],
)
def test_a_request_whose_end_is_not_clear_is_refused(port, headers):
    smuggled = b"0\r\n\r\nGET /smuggled HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
    status, problem = asked(port, POST + headers + b"\r\n" + smuggled)
    assert status == problem["status"] == 400
    assert problem["detail"]
    assert problem["remedy"]


@pytest.mark.fault("request with two lengths")
def test_the_refusal_of_a_head_request_has_no_body(port, caplog):
    said = CHUNKED.replace(b"POST", b"HEAD") + b"zz\r\nx\r\n"
    with closing(connect(port, said)) as peer:
        head, _, body = heard(peer).partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 400")
    assert not body
    assert "Fatal error" not in caplog.text


def test_chunks_are_no_part_of_an_older_version(port):
    said = CHUNKED.replace(b"HTTP/1.1", b"HTTP/1.0") + b"0\r\n\r\n"
    assert asked(port, said)[0] == 400


@pytest.mark.fault(
    "body in a million chunks of one byte",
    group="api",
    outcome="The connection is refused with 400 after 1,000 chunks; others are answered meanwhile.",
)
@pytest.mark.parametrize("path", [b"/login", b"/api/v1/campaigns/check"])
def test_a_body_in_crumbs_is_refused_and_holds_nobody_up(port, path):
    said = CHUNKED.replace(b"/api/v1/campaigns/check", path)
    with closing(connect(port, said)) as peer:
        crumbs = Thread(target=pour, args=(peer, b"1\r\nx\r\n" * 990_000))
        crumbs.start()
        slowest_s = 0.0
        for _ in range(20):
            began_s = time.monotonic()
            assert is_well(port)
            slowest_s = max(slowest_s, time.monotonic() - began_s)
        crumbs.join()
    # Read to its end, such a body would hold all others up for ten seconds and more.
    assert slowest_s < 5.0


def pour(peer: socket.socket, data: bytes) -> None:
    with suppress(OSError):
        peer.sendall(data)


def test_crumbs_are_told_what_is_wrong(port):
    status, problem = asked(port, CHUNKED + b"1\r\n{\r\n" * 1_100)
    assert (status, "too small" in problem["detail"]) == (400, True)
    assert "64 bytes" in problem["remedy"]


def test_a_body_in_chunks_of_a_modest_size_is_taken(port):
    said = BODY[:-1] + b" " * 200_000 + b"}"
    parts = [said[at : at + 100] for at in range(0, len(said), 100)]
    chunks = b"".join(b"%x\r\n%b\r\n" % (len(part), part) for part in parts)
    close = CHUNKED.replace(b"\r\n\r\n", b"\r\nConnection: close\r\n\r\n")
    assert asked(port, close + chunks + b"0\r\n\r\n")[0] == 200


@pytest.mark.fault(
    "requests that are never completed",
    group="api",
    outcome="Each is refused with 408 after 10 s, or 30 s for a body; others are answered.",
)
@pytest.mark.parametrize(
    "half", [b"GE", b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-A: ", CHUNKED + b"5\r\n{"]
)
def test_half_a_request_has_an_end(hurried, half):
    began_s = time.monotonic()
    status, problem = asked(hurried, half)
    assert status == problem["status"] == 408
    assert time.monotonic() - began_s < 20 * SHORT_S
    assert is_well(hurried)


def test_who_says_nothing_is_hung_up_on(hurried):
    with closing(connect(hurried)) as peer:
        assert heard(peer) == b""


def test_who_sends_a_byte_now_and_then_is_not_waited_for(hurried):
    began_s = time.monotonic()
    with closing(connect(hurried, b"GET /healthz HTTP/1.1\r\nX-A: ")) as peer:
        peer.settimeout(SHORT_S / 10)
        while time.monotonic() - began_s < PATIENCE_S:
            try:
                peer.sendall(b"a")
                if peer.recv(1024).startswith(b"HTTP/1.1 408"):
                    break
            except TimeoutError:
                continue
    assert time.monotonic() - began_s < PATIENCE_S / 2


def test_a_slow_and_steady_body_is_taken(monkeypatch, port):
    monkeypatch.setattr(connections, "BODY_S", 2.0)
    monkeypatch.setattr(connections, "SLOWEST_BYTES_PER_S", 3.0)
    length = b"Content-Length: %d\r\nConnection: close\r\n\r\n" % len(BODY)
    began_s = time.monotonic()
    with closing(connect(port, POST + length)) as peer:
        for at in range(len(BODY)):
            peer.sendall(BODY[at : at + 1])
            time.sleep(2.5 / len(BODY))
        assert time.monotonic() - began_s > 2.0
        assert heard(peer).startswith(b"HTTP/1.1 200")


def test_a_body_that_nobody_reads_is_not_drained_for_long(monkeypatch, port):
    monkeypatch.setattr(connections, "DRAIN_S", SHORT_S)
    head = b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 1000000\r\n\r\n"
    with closing(connect(port, head)) as peer:
        assert heard(peer).startswith(b"HTTP/1.1 200")


def test_a_connection_that_is_kept_may_be_used_again(monkeypatch, port):
    monkeypatch.setattr(connections, "HEAD_S", 4.0)
    kept = HEALTH.replace(b"Connection: close\r\n", b"")
    with closing(connect(port, kept)) as peer:
        for _ in range(4):
            said = b""
            while not said.endswith(b"}"):
                said += peer.recv(65536)
            assert said.startswith(b"HTTP/1.1 200")
            time.sleep(1.2)  # four of them are longer than one request may take
            peer.sendall(kept)


@pytest.mark.fault(
    "crowd of half-sent requests",
    group="api",
    outcome="500 connections are open at most: those that idle longest are closed, others served.",
)
def test_more_connections_than_are_allowed_close_the_oldest(port):
    with ExitStack() as stack:
        crowd = [stack.enter_context(closing(connect(port, b"GET / H"))) for _ in range(3 * MOST)]
        assert is_well(port)
        assert all(heard(peer) == b"" for peer in crowd[:MOST])


@pytest.mark.fault(
    "client that reads nothing of its answer",
    group="api",
    outcome="After two minutes without a byte taken, its connection is closed.",
)
def test_who_reads_nothing_is_hung_up_on(monkeypatch, port):
    monkeypatch.setattr(connections, "STALLED_S", SHORT_S)
    lost, forget = Event(), connections.BoundedProtocol.connection_lost

    def connection_lost(protocol, error):
        forget(protocol, error)
        lost.set()

    monkeypatch.setattr(connections.BoundedProtocol, "connection_lost", connection_lost)
    with socket.socket() as peer:
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_096)
        peer.connect(("127.0.0.1", port))
        peer.sendall(b"GET /openapi.json HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" * 200)
        # What the kernel has taken keeps the client from noticing: only the service can tell.
        assert lost.wait(PATIENCE_S)
    assert is_well(port)


@pytest.mark.fault("client that reads nothing of its answer")
def test_who_reads_slowly_gets_the_whole_answer(monkeypatch, port):
    monkeypatch.setattr(connections, "STALLED_S", 5.0)
    count = 40
    with socket.socket() as peer:
        peer.settimeout(PATIENCE_S)
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_096)
        peer.connect(("127.0.0.1", port))
        peer.sendall(b"GET /openapi.json HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" * (count - 1))
        peer.sendall(HEALTH)
        time.sleep(SHORT_S)
        assert heard(peer).count(b"HTTP/1.1 200") == count


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
    assert is_well(port)
    # The peer sees its connection closed before the service has ended, and counted, the request.
    wait_until(lambda: b'status="499"} 3.0' in metrics(port), "three requests are counted")
    assert [record for record in caplog.records if record.exc_info] == []
    assert b'status="5' not in metrics(port)


def metrics(port: int) -> bytes:
    with closing(connect(port, HEALTH.replace(b"healthz", b"metrics"))) as peer:
        return heard(peer)
