"""nginx before the controller, as `deploy/nginx` configures it: no address shuts out another."""

import json
import re
import shutil
import socket
import subprocess
import time
from contextlib import ExitStack, closing
from http.client import HTTPConnection
from pathlib import Path
from threading import Thread

import deadlines
import pytest

from eigenfail_api.__main__ import Server, listen
from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings
from eigenfail_services.store import open_store

CONFIG = Path(__file__).parents[2] / "deploy" / "nginx" / "eigenfail.conf"
CROWD = 500
"""As many connections as the controller takes."""

STREAMS, CONNECTIONS = 10, 50
"""The limits of the configuration, for each address."""

NGINX = shutil.which("nginx") or "/usr/sbin/nginx"
STRANGER, FRIEND = "127.0.0.2", "127.0.0.1"
WRAPPER = """
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
    pytest.mark.skipif(not Path(NGINX).exists(), reason="no nginx: `make tools` installs it"),
]


def configure(folder, text):
    """Write a configuration that includes `text`, and return its path."""
    config = folder / "eigenfail.conf"
    config.write_text(text)
    path = folder / "nginx.conf"
    path.write_text(WRAPPER.format(folder=folder, config=config))
    return path


@pytest.fixture
def ports():
    """Ports of the API and of its health checks, of a controller that believes the proxy."""
    settings = ApiSettings(port=0, proxies=(FRIEND,), health_port=0)
    with closing(open_store("memory://")) as store, listen(FRIEND, 0) as health:
        server = Server(create_app(store, settings), health)
        with listen(FRIEND, 0) as listener:
            thread = Thread(target=server.run, kwargs={"sockets": [listener]})
            thread.start()
            yield listener.getsockname()[1], health.getsockname()[1]
            server.handle_exit(15, None)
            thread.join()


@pytest.fixture
def proxy(ports, tmp_path):
    """The port of nginx before the controller, without TLS."""
    with socket.create_server((FRIEND, 0)) as taken:
        port = taken.getsockname()[1]
    text = CONFIG.read_text()
    changes = {
        "listen 443 ssl;": f"listen {FRIEND}:{port};",
        "server 127.0.0.1:8440;": f"server 127.0.0.1:{ports[0]};",
    }
    for before, after in changes.items():
        assert before in text
        text = text.replace(before, after)
    text = re.sub(r"^\s+ssl_.*\n", "", text, flags=re.MULTILINE)
    config = configure(tmp_path, text)
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


def read_statuses(peers):
    """Return the statuses of the peers that were answered within a second."""
    time.sleep(1.0)
    found = []
    for peer in peers:
        peer.settimeout(0.001)
        try:
            head = peer.recv(4_096)
        except OSError:
            continue
        if head:
            found.append(int(head.split()[1]))
    return found


STREAM = b"GET /api/v1/events HTTP/1.1\r\nHost: localhost\r\nAccept: text/event-stream\r\n\r\n"
SLOW_BODY = (
    b"POST /login HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000\r\n"
    b"Content-Type: application/x-www-form-urlencoded\r\n\r\nkey="
)


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
    "client that takes all connections: streams of events, slow bodies",
    group="api",
    outcome="Behind nginx as `deploy/nginx` configures it, an address has 50 connections and 10 "
    "streams. Other addresses and the port for health checks are answered as before.",
)
@pytest.mark.parametrize("said", [STREAM, SLOW_BODY], ids=["streams", "bodies"])
def test_crowd_of_one_address_leaves_another_one_and_health_checks_alone(ports, proxy, said):
    with ExitStack() as stack:
        peers = crowd(stack, proxy, said)
        statuses = read_statuses(peers)
        limit = STREAMS if said is STREAM else CONNECTIONS
        assert statuses.count(429) == CROWD - limit
        assert statuses.count(200) == (STREAMS if said is STREAM else 0)
        began_s = time.monotonic()
        for _ in range(10):
            assert ask(proxy)[0] == 200
            assert ask(ports[1], "/healthz") == (200, b'{"status":"ok"}')
            assert ask(ports[1], "/readyz") == (200, b'{"status":"ok"}')
        assert (time.monotonic() - began_s) / 30 < 1.0
        if said is SLOW_BODY:
            assert ask(proxy, source=STRANGER)[0] == 429
    assert ask(proxy)[0] == 200


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
