"""The health checks of the containers, against real sockets."""

import http.server
import os
import runpy
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest

HEALTH = Path(__file__).parents[2] / "deploy" / "health.py"


@pytest.fixture
def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def health(free_port, monkeypatch):
    """`main` of the script, looking at a port of this test."""
    monkeypatch.delenv("EIGENFAIL_HEALTH_PORT", raising=False)
    for name in ("EIGENFAIL_PORT", "EIGENFAIL_HUB_PORT", "EIGENFAIL_RAY_PORT"):
        monkeypatch.setenv(name, str(free_port))
    return runpy.run_path(str(HEALTH))["main"]


@pytest.fixture
def controller(free_port):
    class Answers(http.server.BaseHTTPRequestHandler):
        status = 200

        def do_GET(self):
            self.send_response(self.status if self.path == "/readyz" else 404)
            self.end_headers()

        def log_message(self, *_):
            pass

    with http.server.HTTPServer(("127.0.0.1", free_port), Answers) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield Answers
        server.shutdown()
        thread.join()


def test_a_controller_is_well_when_it_is_ready(health, controller):
    assert health("controller") == 0
    controller.status = 503
    assert health("controller") == 1


def test_controller_is_asked_at_its_port_for_health_checks(
    health, controller, free_port, monkeypatch
):
    monkeypatch.setenv("EIGENFAIL_PORT", "9")
    monkeypatch.setenv("EIGENFAIL_HEALTH_PORT", str(free_port))
    assert health("controller") == 0


@pytest.mark.parametrize("role", ["controller", "services", "worker", "ray-head", "ray-node"])
def test_nobody_is_well_where_nothing_runs(health, role):
    assert health(role) == 1


@pytest.mark.parametrize("role", ["services", "ray-head"])
def test_who_is_connected_to_is_well_when_it_listens(health, free_port, role):
    with socket.create_server(("127.0.0.1", free_port)):
        assert health(role) == 0


@pytest.mark.parametrize("role", ["worker", "ray-node"])
def test_who_connects_is_well_while_it_is_connected(health, free_port, role):
    with socket.create_server(("127.0.0.1", free_port)) as hub:
        with socket.create_connection(("127.0.0.1", free_port)):
            accepted, _ = hub.accept()
            assert health(role) == 0
            accepted.close()
        assert health(role) == 1


@pytest.mark.parametrize(("words", "role"), [(["controller"], ""), ([], "controller")])
def test_the_role_is_an_argument_or_a_variable(words, role, free_port):
    environment = os.environ | {"EIGENFAIL_PORT": str(free_port), "EIGENFAIL_ROLE": role}
    command = [sys.executable, HEALTH, *words]
    assert subprocess.run(command, env=environment, check=False).returncode == 1


def test_without_a_role_nothing_is_asked():
    environment = {k: v for k, v in os.environ.items() if k != "EIGENFAIL_ROLE"}
    assert subprocess.run([sys.executable, HEALTH], env=environment, check=False).returncode == 0
