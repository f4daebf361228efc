"""Bridges: the reference one in a thread of the test, or as a program of its own."""

import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from typing import Any

import pytest
import zmq
from msgspec.msgpack import decode, encode
from msgspec.structs import replace

from eigenfail.contracts import Simulation
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.episode import EpisodeSetup
from eigenfail_workers.bridge.connection import SharedConnection, make_timeouts
from eigenfail_workers.bridge.engine import BridgeEngine

EXAMPLES = Path(__file__).parents[3] / "examples" / "bridge"
POLL_MS = 20
PATIENCE_S = 30.0


@pytest.fixture(scope="session")
def minimal() -> Any:
    """The reference bridge as a module."""
    sys.path.insert(0, str(EXAMPLES))
    try:
        import minimal as module
    finally:
        sys.path.pop(0)
    return module


@pytest.fixture
def serving(minimal) -> Callable[..., Any]:
    """Serves the reference bridge from a thread, with other simulations in it if need be."""

    @contextmanager
    def serve(
        open_simulation: Callable[..., Simulation] | None = None, slots: int = 64, **changes: Any
    ):
        welcome = minimal.welcome(slots) | changes
        bridge = minimal.Bridge(welcome, open_simulation or minimal.built_in)
        server, over = zmq.Context.instance().socket(zmq.REP), Event()
        port = server.bind_to_random_port("tcp://127.0.0.1")

        def answer() -> None:
            while not over.is_set():
                if server.poll(POLL_MS):
                    server.send(encode(bridge.answer(decode(server.recv()))))

        thread = Thread(target=answer)
        thread.start()
        try:
            yield f"tcp://127.0.0.1:{port}"
        finally:
            over.set()
            thread.join()
            server.close(linger=0)

    return serve


@pytest.fixture
def on_bridge() -> Iterator[Callable[..., BridgeEngine]]:
    """Engines on the bridge at an address."""
    lines: list[SharedConnection] = []

    def make(
        address: str,
        planner: str = "idm",
        answer_s: float = PATIENCE_S,
        hello_s: float = PATIENCE_S,
        episode_s: float = 2.0 * PATIENCE_S,
        **changes: Any,
    ) -> BridgeEngine:
        usual = make_timeouts(2.0 * PATIENCE_S)
        given = {"answer_s": answer_s, "hello_s": hello_s, "episode_s": episode_s}
        lines.append(SharedConnection(address, replace(usual, **given)))
        given = {
            "simulator": "bridge",
            "scenario": "cut_in",
            "scenario_parameters": {"steps": 100},
            "planner": planner,
            "planner_settings": {},
            "disturbance": DisturbanceModel(),
        }
        return BridgeEngine(EpisodeSetup(**(given | changes)), lines[-1])

    yield make
    for line in lines:
        line.close()


@pytest.fixture
def free_address() -> str:
    """Where nobody listens."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp://127.0.0.1:{probe.getsockname()[1]}"


@pytest.fixture
def run_program() -> Iterator[Callable[..., "subprocess.Popen[bytes]"]]:
    """Starts Python programs, and ends them after the test."""
    started: list[subprocess.Popen[bytes]] = []

    def run(*command: object) -> "subprocess.Popen[bytes]":
        started.append(subprocess.Popen([sys.executable, *map(str, command)]))
        return started[-1]

    yield run
    for program in started:
        program.kill()
        program.wait()
