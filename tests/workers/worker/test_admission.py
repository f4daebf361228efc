"""What a worker makes of a hub that does not let it in, and of whatever else may listen there."""

import socket
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from threading import Thread

import deadlines
import pytest
import zmq
from structlog.testing import capture_logs

from eigenfail.errors import InvalidValue, ServiceUnreachable, Unauthorized
from eigenfail.wire.keys import WorkerKey
from eigenfail_workers import __main__ as program
from eigenfail_workers.worker import hub_connection
from eigenfail_workers.worker.hub_connection import HubConnection

PATIENCE_S = deadlines.PROCESS_S
HTTP = b"HTTP/1.1 400 Bad Request\r\nConnection: close\r\n\r\n"


@pytest.fixture
def key() -> WorkerKey:
    from zmq.utils import z85

    return WorkerKey(*(z85.decode(each) for each in zmq.curve_keypair()))


def server_at(port: int) -> socket.socket:
    """Listens there as soon as who did so before has let go of it."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        with suppress(OSError):
            return socket.create_server(("127.0.0.1", port))
        time.sleep(0.01)
    raise AssertionError(f"port {port} is not free")


@contextmanager
def listening(answer: bytes, port: int = 0) -> Iterator[int]:
    """Something that is no hub: it says the same to everybody and hangs up."""
    with server_at(port) as server:

        def serve() -> None:
            while True:
                try:
                    peer, _ = server.accept()
                except OSError:
                    return
                with peer:
                    peer.sendall(answer)

        thread = Thread(target=serve, daemon=True)
        thread.start()
        yield server.getsockname()[1]
        server.shutdown(socket.SHUT_RDWR)
    thread.join(PATIENCE_S)


def listen_until(link: HubConnection, happened: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not happened():
        assert time.monotonic() < deadline
        assert list(link.receive()) == []
        link.socket.poll(50)


@pytest.mark.parametrize("answer", [b"", HTTP])
@pytest.mark.parametrize("with_key", [True, False])
def test_who_is_no_hub_is_told_so_in_time(monkeypatch, key, answer, with_key) -> None:
    monkeypatch.setattr(hub_connection, "GIVE_UP_S", 0.3)
    with listening(answer) as port:
        link = HubConnection(f"tcp://127.0.0.1:{port}", key if with_key else None)
        with closing(link), pytest.raises((Unauthorized, ServiceUnreachable), match=str(port)):
            listen_until(link, lambda: False)


def test_a_hub_that_is_not_there_is_waited_for(monkeypatch, key: WorkerKey) -> None:
    monkeypatch.setattr(hub_connection, "GIVE_UP_S", 0.0)
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{unused.getsockname()[1]}"
        with closing(HubConnection(address, key)) as link:
            until = time.monotonic() + 0.5
            listen_until(link, lambda: time.monotonic() > until)


def test_so_is_one_that_was_there_behind_what_breaks_off(monkeypatch) -> None:
    monkeypatch.setattr(hub_connection, "GIVE_UP_S", 0.1)
    with zmq.Context.instance().socket(zmq.ROUTER) as hub:
        port = hub.bind_to_random_port("tcp://127.0.0.1")
        link = HubConnection(f"tcp://127.0.0.1:{port}")
        listen_until(link, lambda: link.handshakes._was_accepted)
        hub.setsockopt(zmq.LINGER, 0)
    with closing(link), listening(b"", port), capture_logs() as told:
        listen_until(link, lambda: len(told) >= 3)
    assert {line["event"] for line in told} == {"handshake broken off, trying again"}


def test_a_file_that_everybody_reads_or_that_holds_no_key_is_refused(tmp_path, key) -> None:
    file = tmp_path / "worker.key"
    file.write_text(key.text())
    file.chmod(0o644)
    with pytest.raises(InvalidValue, match="chmod 600") as refusal:
        program.read_key(str(file))
    assert key.text() not in str(refusal.value)
    file.chmod(0o600)
    assert program.read_key(str(file)) == key
    for text in ("", "efw_", key.text()[:-1], key.text() + "A", "é" * 90):
        file.write_text(text)
        with pytest.raises(InvalidValue, match="worker key create"):
            program.read_key(str(file))
    with pytest.raises(InvalidValue, match="No such file"):
        program.read_key(str(tmp_path / "none"))
    assert program.read_key(None) is None
