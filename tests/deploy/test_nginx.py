"""nginx before the controller, as `deploy/nginx` configures it.

No address shuts out another. nginx waits for slow clients, and refuses ambiguous requests.
"""

import json
import os
import re
import shutil
import socket
import subprocess
import time
from collections import Counter
from contextlib import ExitStack, closing, contextmanager, suppress
from http.client import HTTPConnection
from pathlib import Path
from threading import Event, Thread

import deadlines
import pytest
from served import serve

from eigenfail_api.__main__ import listen
from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings
from eigenfail_services.store.store import open_store

CONFIG = Path(__file__).parents[2] / "deploy" / "nginx" / "eigenfail.conf"
CROWD = 500
"""As many connections as the controller takes."""

STREAMS, CONNECTIONS = 10, 50
"""The limits of the configuration, for each address."""

NGINX = shutil.which("nginx") or "/usr/sbin/nginx"
STRANGER, FRIEND = "127.0.0.2", "127.0.0.1"
AS_USER = "" if os.geteuid() else "user root;"
"""Workers need the folder of the test, where bodies are kept. Others than root are not asked."""

WRAPPER = """
{as_user}
worker_processes 1;
daemon off;
pid {folder}/nginx.pid;
error_log {folder}/error.log;
events {{ worker_connections 4096; }}
http {{
    access_log off;
    client_body_temp_path {folder}/body;
    proxy_temp_path {folder}/proxy;
    fastcgi_temp_path {folder}/fastcgi;
    uwsgi_temp_path {folder}/uwsgi;
    scgi_temp_path {folder}/scgi;
    include {config};
}}
"""

pytestmark = [
    pytest.mark.service,
    pytest.mark.skipif(
        not Path(NGINX).exists(), reason="no nginx: deploy/test_tools.sh installs it"
    ),
]


def configure(folder, text):
    """Write a configuration that includes `text`, and return its path."""
    config = folder / "eigenfail.conf"
    config.write_text(text)
    path = folder / "nginx.conf"
    path.write_text(WRAPPER.format(as_user=AS_USER, folder=folder, config=config))
    return path


@pytest.fixture
def ports():
    """Ports of the API and of its health checks, of a controller that believes the proxy."""
    settings = ApiSettings(port=0, proxies=(FRIEND,), health_port=0)
    with (
        closing(open_store("memory://")) as store,
        listen(FRIEND, 0) as health,
        serve(create_app(store, settings), health) as port,
    ):
        yield port, health.getsockname()[1]


@pytest.fixture
def proxy(ports, tmp_path):
    """The port of nginx before the controller, without TLS."""
    with run_nginx(ports, tmp_path, {}) as port:
        yield port


@pytest.fixture
def impatient_proxy(ports, tmp_path):
    """The same, with time limits that a test can wait for."""
    limits = ("client_header_timeout", "client_body_timeout")
    with run_nginx(ports, tmp_path, {f"{name} 10s": f"{name} 2s" for name in limits}) as port:
        yield port


@contextmanager
def run_nginx(ports, folder, changes):
    """Run nginx with changes to its configuration, and return its port."""
    with socket.create_server((FRIEND, 0)) as taken:
        port = taken.getsockname()[1]
    text = CONFIG.read_text()
    changes = changes | {
        "listen 443 ssl;": f"listen {FRIEND}:{port};",
        "server 127.0.0.1:8440;": f"server 127.0.0.1:{ports[0]};",
    }
    for before, after in changes.items():
        assert before in text
        text = text.replace(before, after)
    text = re.sub(r"^\s+ssl_.*\n", "", text, flags=re.MULTILINE)
    config = configure(folder, text)
    program = subprocess.Popen([NGINX, "-c", str(config)], stderr=subprocess.PIPE)
    try:
        until_s = time.monotonic() + deadlines.PROCESS_S
        while True:
            try:
                ask(port)
                break
            except OSError:
                assert program.poll() is None, program.communicate()[1]
                assert time.monotonic() < until_s
                time.sleep(0.05)
        yield port
    finally:
        program.terminate()
        program.communicate()


def ask(port, path="/api/v1/campaigns", source=FRIEND):
    """Return status and body of a request from an address of this machine."""
    with closing(
        HTTPConnection(FRIEND, port, timeout=deadlines.PROCESS_S, source_address=(source, 0))
    ) as link:
        link.request("GET", path, headers={"Host": "localhost"})
        response = link.getresponse()
        return response.status, response.read()


def crowd(stack, port, said):
    """Open connections of the stranger, each of which sends the same."""
    found = []
    for _ in range(CROWD):
        peer = socket.create_connection((FRIEND, port), source_address=(STRANGER, 0))
        found.append(stack.enter_context(peer))
        peer.sendall(said)
    return found


def count_statuses(peers):
    """Return how many peers got which status within a second."""
    time.sleep(1.0)
    found = Counter()
    for peer in peers:
        peer.settimeout(0.001)
        try:
            head = peer.recv(4_096)
        except TimeoutError:
            found[WAITING] += 1
        else:
            found[int(head.split()[1])] += 1
    return found


STREAM = b"GET /api/v1/events HTTP/1.1\r\nHost: localhost\r\nAccept: text/event-stream\r\n\r\n"
POST = (
    b"POST /login HTTP/1.1\r\nHost: localhost\r\n"
    b"Content-Type: application/x-www-form-urlencoded\r\n"
)
SLOW_HEAD = POST + b"X-A: "
SLOW_BODY = POST + b"Content-Length: 1000\r\n\r\nkey="
CHUNKED = POST + b"Transfer-Encoding: chunked\r\n"
CRUMBS = CHUNKED + b"\r\n" + b"1\r\nx\r\n" * 2_000
OVERSIZED = POST + b"Content-Length: 2000000\r\n\r\nkey="
SMUGGLED = b"0\r\n\r\nGET /smuggled HTTP/1.1\r\nHost: localhost\r\n\r\n"
TWO_LENGTHS = CHUNKED + b"Content-Length: 5\r\n\r\n" + SMUGGLED

BUSY, WAITING = 429, 0
"""A refusal for too many requests, and no answer yet."""

CROWDS = {
    "streams": (STREAM, {200: STREAMS, BUSY: CROWD - STREAMS}),
    "slow heads": (SLOW_HEAD, {WAITING: CROWD}),
    "slow bodies": (SLOW_BODY, {WAITING: CONNECTIONS, BUSY: CROWD - CONNECTIONS}),
    "tiny chunks": (CRUMBS, {WAITING: CONNECTIONS, BUSY: CROWD - CONNECTIONS}),
    "two lengths": (TWO_LENGTHS, {400: CROWD}),
    "oversized bodies": (OVERSIZED, {413: CROWD}),
}
"""What each member of a crowd sends, and how many get which status."""


def test_configuration_is_one_that_nginx_takes(tmp_path):
    certificate, key = tmp_path / "a.pem", tmp_path / "a.key"
    command = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-subj", "/CN=a"]
    subprocess.run(
        [*command, "-keyout", str(key), "-out", str(certificate)], check=True, capture_output=True
    )
    text = CONFIG.read_text().replace("/etc/ssl/certs/eigenfail.pem", str(certificate))
    text = text.replace("/etc/ssl/private/eigenfail.key", str(key))
    config = configure(tmp_path, text)
    command = [NGINX, "-t", "-c", str(config)]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "warn" not in done.stderr


@pytest.mark.fault(
    "client that takes all connections: streams of events, slow heads or bodies, tiny chunks",
    group="api",
    outcome="Behind nginx as `deploy/nginx` configures it, an address has 50 connections and 10 "
    "streams. Other addresses and the port for health checks are answered as before.",
)
@pytest.mark.parametrize("kind", CROWDS)
def test_crowd_of_one_address_leaves_another_one_and_health_checks_alone(ports, proxy, kind):
    said, expected = CROWDS[kind]
    with ExitStack() as stack:
        assert count_statuses(crowd(stack, proxy, said)) == expected
        began_s = time.monotonic()
        for _ in range(10):
            assert ask(proxy)[0] == 200
            assert ask(ports[1], "/healthz") == (200, b'{"status":"ok"}')
            assert ask(ports[1], "/readyz") == (200, b'{"status":"ok"}')
        assert (time.monotonic() - began_s) / 30 < 1.0
        if said in {SLOW_BODY, CRUMBS}:
            assert ask(proxy, source=STRANGER)[0] == BUSY
    assert ask(proxy)[0] == 200


@pytest.mark.fault(
    "requests that are never completed",
    group="api",
    outcome="Behind nginx, each is closed 10 s after its beginning, or after the last part of its "
    "body. The controller hears of none of them.",
)
@pytest.mark.parametrize("said", [SLOW_HEAD, SLOW_BODY, CRUMBS], ids=["head", "body", "chunks"])
def test_half_a_request_has_an_end(impatient_proxy, said):
    with socket.create_connection((FRIEND, impatient_proxy), deadlines.PROCESS_S) as peer:
        peer.sendall(said)
        assert hear_to_the_end(peer) in {b"", b"HTTP/1.1 408 "}


def test_head_that_drips_has_an_end(impatient_proxy):
    over = Event()
    with socket.create_connection((FRIEND, impatient_proxy), deadlines.PROCESS_S) as peer:

        def drip():
            peer.sendall(SLOW_HEAD)
            with suppress(OSError):
                while not over.wait(0.1):
                    peer.sendall(b"a")

        thread = Thread(target=drip)
        thread.start()
        assert hear_to_the_end(peer) in {b"", b"HTTP/1.1 408 "}
        over.set()
        thread.join()


@pytest.mark.fault(
    "body in a million chunks of one byte",
    group="api",
    outcome="nginx passes it on in one piece; others are answered meanwhile.",
)
def test_body_in_crumbs_holds_nobody_up(proxy):
    with socket.create_connection((FRIEND, proxy), deadlines.PROCESS_S) as peer:
        body = b"1\r\nx\r\n" * 990_000 + b"0\r\n\r\n"
        crumbs = Thread(target=peer.sendall, args=(CHUNKED + b"\r\n" + body,))
        crumbs.start()
        for _ in range(20):
            began_s = time.monotonic()
            assert ask(proxy)[0] == 200
            assert time.monotonic() - began_s < 5.0
        crumbs.join()
        assert peer.recv(4_096).startswith(b"HTTP/1.1 4")


@pytest.mark.fault(
    "request with two lengths",
    group="api",
    outcome="nginx refuses it and closes its connection. The controller does not see it.",
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
@pytest.mark.parametrize("version", [b"HTTP/1.1", b"HTTP/1.0"])
def test_request_whose_end_is_not_clear_is_refused(proxy, headers, version):
    with socket.create_connection((FRIEND, proxy), deadlines.PROCESS_S) as peer:
        peer.sendall(POST.replace(b"HTTP/1.1", version) + headers + b"\r\n" + SMUGGLED)
        assert hear_to_the_end(peer) in {b"HTTP/1.1 400 ", b"HTTP/1.1 501 "}


def test_chunks_are_no_part_of_an_older_version(proxy):
    with socket.create_connection((FRIEND, proxy), deadlines.PROCESS_S) as peer:
        peer.sendall(CHUNKED.replace(b"HTTP/1.1", b"HTTP/1.0") + b"\r\n0\r\n\r\n")
        assert hear_to_the_end(peer) == b"HTTP/1.1 400 "


def test_body_of_chunks_that_grows_too_large_is_refused(proxy):
    with socket.create_connection((FRIEND, proxy), deadlines.PROCESS_S) as peer:
        with suppress(OSError):
            peer.sendall(CHUNKED + b"\r\n" + (b"8000\r\n" + b"x" * 0x8000 + b"\r\n") * 33)
        assert peer.recv(13) == b"HTTP/1.1 413 "


def hear_to_the_end(peer):
    """Return the beginning of all that is answered; there is one answer at most."""
    told = b""
    with suppress(ConnectionResetError):
        while data := peer.recv(65_536):
            told += data
    assert told.count(b"HTTP/1.1 ") <= 1
    return told[:13]


def test_events_pass_the_proxy_at_once(proxy):
    with socket.create_connection((FRIEND, proxy), deadlines.PROCESS_S) as follower:
        follower.sendall(STREAM)
        follower.recv(4_096)
        body = {
            "name": "a",
            "method": "monte_carlo",
            "episodes": 10,
            "planner": "idm",
            "simulator": "point_mass",
        }
        with closing(HTTPConnection(FRIEND, proxy, timeout=deadlines.PROCESS_S)) as link:
            headers = {"Host": "localhost", "Content-Type": "application/json"}
            link.request("POST", "/api/v1/campaigns", json.dumps(body), headers)
            assert link.getresponse().status == 201
        told = b""
        while b"campaign.created" not in told and b'"campaign":1' not in told:
            told += follower.recv(4_096)


def test_proxy_hides_health_checks_and_names_no_user(proxy):
    assert ask(proxy, "/healthz")[0] == 404
    assert ask(proxy, "/readyz")[0] == 404
    text = CONFIG.read_text()
    assert 'X-Forwarded-User "";' in text
    assert "X-Forwarded-For $remote_addr;" in text
