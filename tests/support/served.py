"""The API behind a socket, in a thread of the test."""

import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Thread

import deadlines
from fastapi import FastAPI

from eigenfail_api.__main__ import Server, listen


@contextmanager
def serve(app: FastAPI, health: socket.socket | None = None) -> Iterator[int]:
    """Serve an application on a free port of this machine, which is returned, to the end."""
    server = Server(app, health)
    with listen("127.0.0.1", 0) as listener:
        thread = Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        while not server.started:
            time.sleep(0.01)
        try:
            yield listener.getsockname()[1]
        finally:
            server.handle_exit(15, None)
            thread.join(timeout=deadlines.PROCESS_S)
            assert not thread.is_alive()
