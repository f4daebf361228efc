"""Processes of a service that a test starts, kills, holds up and ends."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from itertools import count
from pathlib import Path

import deadlines
import psutil

from eigenfail.client import Client

PATIENCE_S = deadlines.PROCESS_S
LOOK_AGAIN_S = 0.05
"""Seldom enough that looking, which is a query mostly, takes little of the processor."""
LEARNER = "learner_process"
STOPPED = "TtZX"
"""States of threads that do nothing, in the kernel's letters."""

FIRST_PORT, PORTS_EACH = 10_000, 2_000
PROCESS = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
OTHERS_APART = 37
numbers = count(OTHERS_APART * os.getpid())


def wait_until(condition: Callable[[], bool], what: str, patience_s: float = PATIENCE_S) -> None:
    """Look again and again, for as long as a slow machine may need."""
    deadline = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < deadline, f"waited in vain: {what}"
        time.sleep(LOOK_AGAIN_S)


def free_port() -> int:
    """Where somebody may listen, and listen again after being killed.

    It lies below those that the system gives to whoever asks for any, and processes that run tests
    side by side look in different places: nobody takes it before it is listened on.
    """
    first = FIRST_PORT + PORTS_EACH * PROCESS
    return next(port for n in numbers if is_free(port := first + n % PORTS_EACH))


def is_free(port: int) -> bool:
    """Whether nobody listens there."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


def stands_still(pid: int) -> bool:
    """Whether no thread of a process runs, or there is no such process any more."""
    tasks = Path(f"/proc/{pid}/task")
    try:
        told = [(task / "stat").read_text() for task in tasks.iterdir()]
    except OSError:  # a thread ended as we looked
        return not tasks.exists()
    return all(text.rpartition(")")[2].split()[0] in STOPPED for text in told)


class Started:
    """A process that a test started; what it says goes to a file."""

    def __init__(self, words: list[str], log: Path) -> None:
        self.log = log
        with log.open("ab") as stream:
            self.said_before = stream.tell()
            self.process = subprocess.Popen(
                [sys.executable, "-m", *words], stdout=stream, stderr=stream
            )

    @property
    def alive(self) -> bool:
        """Whether it has not ended."""
        return self.process.poll() is None

    def said(self) -> str:
        """What it has said so far."""
        return self.log.read_bytes()[self.said_before :].decode(errors="replace")

    def below(self) -> list[psutil.Process]:
        """The processes that it started, and those that these did; parents come first."""
        return psutil.Process(self.process.pid).children(recursive=True) if self.alive else []

    def kill(self) -> None:
        """kill -9, as the out-of-memory killer does it."""
        self.process.kill()
        self.process.wait()

    def halt(self) -> None:
        """Stand still until `go_on`, as on a machine that is suspended; its children, too."""
        pids = [*(child.pid for child in self.below()), self.process.pid]
        for pid in pids:
            os.kill(pid, signal.SIGSTOP)
        # The signal is sent before every thread has heard it: one may yet begin a transaction.
        wait_until(lambda: all(map(stands_still, pids)), "all threads stand still")

    def go_on(self) -> None:
        """After `halt`."""
        for pid in (self.process.pid, *(child.pid for child in self.below())):
            os.kill(pid, signal.SIGCONT)

    def end(self, signal_: int = signal.SIGTERM) -> int:
        """Ask it to stop; its exit status."""
        self.process.send_signal(signal_)
        return self.process.wait(PATIENCE_S)


class Services(Started):
    """A services process: hub, supervisor, and the learners below it."""

    def __init__(self, url: str, hub: str, log: Path, *options: str) -> None:
        words = ["eigenfail_services", "--database", url, "--hub", hub, "--launcher", "none"]
        super().__init__([*words, *options], log)
        self.hub = hub
        wait_until(self._is_ready, "the services are ready")

    def _is_ready(self) -> bool:
        assert self.alive, self.said()
        return any(json.loads(line) for line in self.said().splitlines() if line.startswith("{"))

    def learners(self) -> list[psutil.Process]:
        """The processes of its learners."""
        return [child for child in self.below() if is_learner(child)]


def is_learner(process: psutil.Process) -> bool:
    """Whether it is one, and lives."""
    try:
        return LEARNER in " ".join(process.cmdline())
    except psutil.Error:  # it died as we looked
        return False


class Worker(Started):
    """A worker that was started by hand."""

    def __init__(self, hub: str, name: str, log: Path) -> None:
        super().__init__(["eigenfail_workers", "--connect", hub, "--name", name], log)
        self.name = name

    def kill_child(self) -> None:
        """kill -9 of the process in which simulator and planner run."""
        for process in self.inner():
            process.kill()

    def inner(self) -> list[psutil.Process]:
        """That process, and what it started; its guard is the first one below."""
        return self.below()[1:]


class Controller(Started):
    """A controller process: it answers HTTP."""

    def __init__(self, url: str, log: Path, address: str = "") -> None:
        self.url = address or f"http://127.0.0.1:{free_port()}"
        port = self.url.rpartition(":")[2]
        super().__init__(["eigenfail_api", "--database", url, "--port", port], log)
        with Client(self.url) as client:
            wait_until(client.health, "the controller answers")
