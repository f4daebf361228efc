"""A real service on real sockets, and real workers that a test starts, stops and kills."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import deadlines
import psutil
import pytest

from eigenfail.client import Client
from eigenfail.hosting.service import Launcher, LocalService, Plan, local_service


class Worker:
    """A worker started by hand."""

    def __init__(self, hub: str, name: str) -> None:
        command = [sys.executable, "-m", "eigenfail_workers", "--connect", hub, "--name", name]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL)

    def kill(self) -> None:
        """kill -9, as the out-of-memory killer does it."""
        os.kill(self.process.pid, signal.SIGKILL)
        self.process.wait()

    def kill_child(self) -> None:
        """kill -9 of the process in which simulator and planner run."""
        until_s = time.monotonic() + deadlines.PROCESS_S
        # A worker that has just been started has its guard first, and this process later.
        while len(family := psutil.Process(self.process.pid).children(recursive=True)) < 2:
            assert time.monotonic() < until_s, "the worker starts no process for episodes"
            time.sleep(0.02)
        for child in family[1:]:
            child.kill()

    def stop(self) -> None:
        self.process.terminate()
        self.process.wait(deadlines.PROCESS_S)


@pytest.fixture(scope="session")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LocalService]:
    """One for all files: each test waits for the end of its campaigns, and workers are its own."""
    plan = Plan(tmp_path_factory.mktemp("data"), port=0, launcher=Launcher.NONE)
    with local_service(plan) as running:
        yield running


@pytest.fixture
def client(service: LocalService) -> Iterator[Client]:
    with Client(service.address.url) as connected:
        yield connected


@pytest.fixture(scope="module")
def lasting_worker(service: LocalService) -> Iterator[Worker]:
    """One worker for all tests of a module that have no need of their own."""
    worker = Worker(service.address.hub, "lasting")
    yield worker
    worker.stop()


@pytest.fixture
def start_worker(service: LocalService) -> Iterator[Callable[..., Worker]]:
    workers: list[Worker] = []

    def start(name: str = "w") -> Worker:
        workers.append(Worker(service.address.hub, f"{name}-{len(workers)}"))
        return workers[-1]

    yield start
    for worker in workers:
        if worker.process.poll() is None:
            worker.stop()


@pytest.fixture
def fresh_service(tmp_path: Path) -> Callable[..., "contextmanager[LocalService]"]:
    """Starts services on one folder, one after the other."""

    @contextmanager
    def start(launcher: Launcher = Launcher.NONE, **staff: object) -> Iterator[LocalService]:
        with ExitStack() as stack:
            staffed: dict[str, Any] = {"workers": 1} | staff
            plan = Plan(tmp_path / "data", port=0, launcher=launcher, **staffed)
            yield stack.enter_context(local_service(plan))

    return start
