"""A client that was given the address of something else than a service, over real sockets."""

import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from threading import Thread

import pytest
import zmq

from eigenfail.client import Client
from eigenfail.errors import ServiceUnreachable

WORDS = r"at 127.0.0.1:\d+ speaks ZeroMQ, as a hub does to workers\. .*eigenfail up"


@pytest.fixture
def hub() -> Iterator[str]:
    """Where workers would connect, as an address of HTTP."""
    with zmq.Context() as context, context.socket(zmq.ROUTER) as router:
        port = router.bind_to_random_port("tcp://127.0.0.1")
        yield f"http://127.0.0.1:{port}"


@pytest.mark.fault(
    "client that connects to the hub's port",
    group="messages",
    outcome="One sentence at once names the mistake.",
)
@pytest.mark.timeout(30)
def test_the_port_of_a_hub_is_told_at_once(hub):
    with Client(hub) as client:
        for ask in (
            lambda: client.campaigns.get(1),
            lambda: client.campaigns.cancel(1),
            lambda: next(client.events.follow()),
        ):
            with pytest.raises(ServiceUnreachable, match=WORDS):
                ask()
        assert not client.health()
        assert isinstance(client.trouble(), ServiceUnreachable)


@pytest.mark.fault("client that connects to the hub's port")
def test_one_sentence_and_an_exit_code_on_the_command_line(hub):
    command = [Path(sys.executable).with_name("eigenfail"), "campaign", "list", "--url", hub]
    told = subprocess.run(command, capture_output=True, text=True, check=False)
    assert told.returncode == 3
    assert told.stderr.count("\n") == 1
    assert "speaks ZeroMQ" in told.stderr


@pytest.mark.parametrize("answer", [b"", b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\n{}"])
def test_whoever_else_listens_is_heard_to_the_end(answer):
    listener = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        with listener.accept()[0] as connection:
            connection.recv(65_536)
            connection.sendall(answer)

    thread = Thread(target=serve)
    thread.start()
    with listener, Client(f"http://127.0.0.1:{listener.getsockname()[1]}") as client:
        assert client.health() is bool(answer)
        thread.join()
