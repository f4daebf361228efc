"""A hub that a test plays, over a real socket; and workers as programs of their own."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import deadlines
import pytest
import zmq

from eigenfail.wire.messages import Assembler, Piece, encode, read_worker_message

WITHIN_S = deadlines.PROCESS_S
LOADED = "from eigenfail_workers import __main__; __main__.main()"


class PlayedHub:
    """Says what the test wants said, and keeps what the worker says."""

    def __init__(self) -> None:
        self.socket = zmq.Context.instance().socket(zmq.ROUTER)
        port = self.socket.bind_to_random_port("tcp://127.0.0.1")
        self.address = f"tcp://127.0.0.1:{port}"
        self.worker = b""
        self.assembler = Assembler()

    def hear(self, kind: type, within_s: float = WITHIN_S):
        """The next message of that kind; others are passed over."""
        deadline = time.monotonic() + within_s
        while (left := deadline - time.monotonic()) > 0:
            if self.socket.poll(int(left * 1000)):
                self.worker, data = self.socket.recv_multipart()
                message = read_worker_message(data)
                if isinstance(message, Piece) and (whole := self.assembler.add(message)):
                    message = read_worker_message(whole)
                if isinstance(message, kind):
                    return message
        raise AssertionError(f"no {kind.__name__} within {within_s} s")

    def say(self, *messages) -> None:
        for message in messages:
            data = message if isinstance(message, bytes) else encode(message)
            self.socket.send_multipart([self.worker, data])


@pytest.fixture
def hub() -> Iterator[PlayedHub]:
    played = PlayedHub()
    yield played
    played.socket.close(linger=0)


@pytest.fixture(scope="module")
def lasting_hub() -> Iterator[PlayedHub]:
    played = PlayedHub()
    yield played
    played.socket.close(linger=0)


@pytest.fixture
def eventually() -> Callable[[Callable[[], object]], None]:
    """Waits until a condition holds."""

    def wait(condition: Callable[[], object]) -> None:
        deadline = time.monotonic() + WITHIN_S
        while not condition():
            assert time.monotonic() < deadline, "it did not come to that"
            time.sleep(0.02)

    return wait


@pytest.fixture
def start_worker(hub: PlayedHub, tmp_path: Path) -> Iterator[Callable[..., subprocess.Popen]]:
    """Starts `eigenfail worker`, after some statements; what it says is in `tmp_path / "said"`."""
    started: list[subprocess.Popen] = []

    def start(*options: str, first: str = "", **variables: str) -> subprocess.Popen:
        command = [sys.executable, "-c", f"{first}\n{LOADED}", "--connect", hub.address, *options]
        with (tmp_path / "said").open("wb") as said:
            started.append(subprocess.Popen(command, stderr=said, env=os.environ | variables))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.wait()
