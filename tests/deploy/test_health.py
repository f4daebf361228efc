"""The health checks of the containers, against real sockets."""

import http.server
import runpy
import socket
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
def health(free_port):
    """`main` of the script, looking at a port of this test."""
    names = runpy.run_path(str(HEALTH))
    names["main"].__globals__.update(CONTROLLER_PORT=free_port, HUB_PORT=free_port)
    return names["main"]


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


@pytest.mark.parametrize("role", ["controller", "services", "worker"])
def test_nobody_is_well_where_nothing_runs(health, role):
    assert health(role) == 1


def test_services_are_well_when_the_hub_listens(health, free_port):
    with socket.create_server(("127.0.0.1", free_port)):
        assert health("services") == 0


def test_a_worker_is_well_while_it_is_connected(health, free_port):
    with socket.create_server(("127.0.0.1", free_port)) as hub:
        with socket.create_connection(("127.0.0.1", free_port)):
            accepted, _ = hub.accept()
            assert health("worker") == 0
            accepted.close()
        assert health("worker") == 1
