"""Health checks at a port of their own: answered whatever the other port is busy with."""

import asyncio
import errno
import json
import socket
import threading
import time
from contextlib import ExitStack, closing
from http.client import HTTPConnection
from threading import Event, Thread

import deadlines
import pytest
from served import serve

from eigenfail.errors import StoreUnavailable
from eigenfail_api.__main__ import listen, read_settings
from eigenfail_api.app import create_app
from eigenfail_api.routes import operations
from eigenfail_api.settings import ApiSettings

MOST = 10
STREAM = b"GET /api/v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n"


@pytest.fixture
def app(store):
    return create_app(store, ApiSettings(port=0, max_connections=MOST, health_port=0))


@pytest.fixture
def ports(app):
    """Ports of the API and of its health checks."""
    with listen("127.0.0.1", 0) as health, serve(app, health) as port:
        yield port, health.getsockname()[1]


def ask(port, path, method="GET"):
    link = HTTPConnection("127.0.0.1", port, timeout=deadlines.PROCESS_S)
    with closing(link):
        link.request(method, path)
        response = link.getresponse()
        return response.status, json.loads(response.read() or b"null")


def connect(stack, port, said=b""):
    peer = socket.create_connection(("127.0.0.1", port), timeout=deadlines.PROCESS_S)
    stack.enter_context(peer)
    peer.sendall(said)
    return peer


def test_health_is_answered_while_all_connections_are_taken(ports):
    port, health = ports
    with ExitStack() as stack:
        for _ in range(MOST):
            assert connect(stack, port, STREAM).recv(4_096).startswith(b"HTTP/1.1 200")
        refused = connect(stack, port, b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert refused.recv(4_096).startswith(b"HTTP/1.1 503")
        assert ask(health, "/healthz") == (200, {"status": "ok"})
        assert ask(health, "/readyz") == (200, {"status": "ok"})


def test_readiness_names_the_problem_and_liveness_does_not_depend_on_it(ports, store, monkeypatch):
    def fail():
        raise StoreUnavailable("The database is away.", "Bring it back.")

    monkeypatch.setattr(store, "ping", fail)
    status, told = ask(ports[1], "/readyz?verbose=1")
    assert (status, told["type"]) == (503, "urn:eigenfail:store-unavailable")
    assert told["remedy"] == "Bring it back."
    assert ask(ports[1], "/healthz")[0] == 200


def test_check_that_raises_anything_has_an_answer(ports, store, monkeypatch):
    def fail():
        raise RuntimeError("nobody expected this")

    monkeypatch.setattr(store, "ping", fail)
    status, told = ask(ports[1], "/readyz")
    assert status == 503
    assert told["detail"] == "The check raised RuntimeError: nobody expected this"


def test_head_has_no_body(ports):
    with ExitStack() as stack:
        peer = connect(stack, ports[1], b"HEAD /healthz HTTP/1.1\r\n\r\n")
        head, _, body = b"".join(iter(lambda: peer.recv(4_096), b"")).partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 200")
    assert body == b""


class Crowded(socket.socket):
    """A socket whose first connection finds no descriptor left."""

    refusals = 1

    def accept(self):
        if self.refusals:
            self.refusals -= 1
            raise OSError(errno.EMFILE, "Too many open files")
        return super().accept()


def test_health_port_outlives_a_connection_that_cannot_be_accepted(app):
    loop = asyncio.new_event_loop()
    thread = Thread(target=loop.run_forever)
    thread.start()
    with Crowded() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        operations.HealthServer(listener, app.state.readiness).start(loop)
        assert ask(listener.getsockname()[1], "/healthz")[0] == 200
    loop.call_soon_threadsafe(loop.stop)
    thread.join()
    loop.close()


def test_process_whose_event_loop_hangs_is_not_healthy(app, monkeypatch):
    monkeypatch.setattr(operations, "PROBE_LIMIT_S", 0.1)
    monkeypatch.setattr(operations, "LOOP_LIMIT_S", 0.1)
    over, loop = Event(), asyncio.new_event_loop()
    thread = Thread(target=loop.run_forever)
    thread.start()
    loop.call_soon_threadsafe(over.wait)
    with listen("127.0.0.1", 0) as listener:
        operations.HealthServer(listener, app.state.readiness).start(loop)
        status, told = ask(listener.getsockname()[1], "/healthz")
        over.set()
        monkeypatch.undo()
        assert ask(listener.getsockname()[1], "/healthz")[0] == 200
    loop.call_soon_threadsafe(loop.stop)
    thread.join()
    loop.close()
    assert status == 503
    assert "event loop" in told["detail"]


def test_other_requests_are_refused_and_half_ones_have_an_end(ports, monkeypatch):
    health = ports[1]
    assert ask(health, "/api/v1/campaigns")[0] == 404
    assert ask(health, "/healthz", "POST")[0] == 404
    monkeypatch.setattr(operations, "HEAD_S", 0.2)
    with ExitStack() as stack:
        halves = [
            connect(stack, health, b"GET /healthz") for _ in range(operations.MOST_PROBES + 8)
        ]
        assert ask(health, "/healthz")[0] == 200
        assert halves[0].recv(100) == b""


def test_health_port_is_a_setting_and_none_by_default(monkeypatch):
    assert read_settings([]).health_port is None
    monkeypatch.setenv("EIGENFAIL_HEALTH_PORT", "8442")
    settings = read_settings([])
    assert (settings.health_host, settings.health_port) == ("127.0.0.1", 8442)


def test_health_check_leaves_no_thread_behind(ports):
    for _ in range(20):
        assert ask(ports[1], "/healthz")[0] == 200
    until_s = time.monotonic() + deadlines.PROCESS_S
    while any("(_serve)" in each.name for each in threading.enumerate()):
        assert time.monotonic() < until_s
        time.sleep(0.01)
