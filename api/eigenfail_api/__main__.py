"""`python -m eigenfail_api`: serve the API until a signal stops it."""

import asyncio
import errno
import signal
import socket
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from types import FrameType

import uvicorn
from fastapi import FastAPI
from pydantic import ValidationError
from pydantic_settings import SettingsError

from eigenfail import logs
from eigenfail.command_line import Parser, checked_stdout
from eigenfail.errors import EigenfailError, InvalidValue, PortTaken
from eigenfail.processes import end_now
from eigenfail.values.access import redact
from eigenfail_api.app import create_app
from eigenfail_api.problems import describe_error
from eigenfail_api.routes.operations import HealthServer
from eigenfail_api.settings import ApiSettings, refuse_open_door
from eigenfail_services import observability
from eigenfail_services.store.store import open_store

GRACE_S = 5
BACKLOG = 2048

KEEP_ALIVE_S = 75
"""Longer than nginx keeps its connections: it would send requests into one that is closing."""

WAIT_S = 2.0
"""Time that a statement of a request waits for the lock of another program. [s]"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve; the exit code says why it ended."""
    try:
        logs.configure("controller")
        with checked_stdout():
            serve(read_settings(arguments))
    except EigenfailError as error:
        sys.stderr.write(redact(f"eigenfail: {error}\n"))
        return error.exit_code
    return 0


def read_settings(arguments: Sequence[str] | None) -> ApiSettings:
    """Return the settings: arguments first, environment variables for the rest.

    Raises:
        InvalidValue: a value of the wrong type or outside its bounds.
    """
    parser = Parser(prog="python -m eigenfail_api", description=__doc__)
    parser.add_argument("--database", help="URL of the store")
    parser.add_argument("--host", help="address to listen on")
    parser.add_argument("--port", help="port to listen on; 0 takes a free one")
    given = vars(parser.parse_args(arguments))
    try:
        return ApiSettings(**{name: value for name, value in given.items() if value is not None})
    except ValidationError as error:
        first = error.errors()[0]
        name = str(first["loc"][0])
        remedy = f"Correct EIGENFAIL_{name.upper()}, or the argument of that name."
        raise InvalidValue(name, describe_error(first), remedy) from None
    except SettingsError as error:
        remedy = "Give lists as JSON, numbers as digits."
        raise InvalidValue("environment", f"{error}.", remedy) from None


def serve(settings: ApiSettings) -> None:
    """Serve until a signal says to stop.

    Raises:
        InvalidValue: the address is not valid, or would let in strangers.
        PortTaken: another process listens there.
        ServiceError: the store cannot be opened.
    """
    refuse_open_door(settings)
    with listen(settings.host, settings.port) as listener, ExitStack() as others:
        health = None
        if settings.health_port is not None:
            health = others.enter_context(listen(settings.health_host, settings.health_port))
        end_traces = observability.configure("controller")
        store = open_store(settings.database, wait_s=WAIT_S)
        try:
            server = Server(create_app(store, settings), health)
            # uvicorn handles signals from its start on. A handler until then must not raise: where
            # the signal arrives during a callback of the garbage collector, Python prints the
            # exception and ignores it, and the server would go on.
            for stop in (signal.SIGINT, signal.SIGTERM):
                signal.signal(stop, server.handle_exit)
            announce("eigenfail API", listener)
            if health is not None:
                announce("health checks", health)
            server.run(sockets=[listener])
        finally:
            store.close()
            end_traces()


def announce(what: str, listener: socket.socket) -> None:
    """Print where something listens: the port may have been chosen just now."""
    host, port = listener.getsockname()[:2]
    sys.stdout.write(f"{what} on http://{f'[{host}]' if ':' in host else host}:{port}\n")
    sys.stdout.flush()


def listen(host: str, port: int) -> socket.socket:
    """Return a listening socket, so that a taken port is known before anything else is done.

    Raises:
        PortTaken: another process listens there.
        InvalidValue: the address is not one of this machine.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        listener = socket.create_server((host, port), family=family, backlog=BACKLOG)
    except OSError as error:
        where = f"{host}:{port}"
        if error.errno == errno.EADDRINUSE:
            remedy = "Stop the process that uses it, or choose another port with --port."
            raise PortTaken(f"Port {port} of {host} is taken.", remedy) from error
        raise InvalidValue("host", f"Cannot listen on {where}: {error.strerror}.") from error
    # What it accepts inherits it. A body that waited for the acknowledgement of its headers would
    # come 40 ms late: asyncio itself sets it for sockets that name their protocol alone.
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listener


class Server(uvicorn.Server):
    """uvicorn that ends event streams before it waits for requests to end.

    Args:
        app: application to serve. Its settings limit the number of open connections. The
            application reads the headers of proxies itself: uvicorn would believe any local
            program.
        health: socket for health checks, if there is one.
    """

    def __init__(self, app: FastAPI, health: socket.socket | None = None) -> None:
        settings: ApiSettings = app.state.settings
        config = uvicorn.Config(
            app,
            log_config=None,
            log_level="warning",
            server_header=False,
            http="h11",
            ws="none",
            backlog=BACKLOG,
            # uvicorn counts the connection on which it refuses a request.
            limit_concurrency=settings.max_connections + 1,
            timeout_keep_alive=KEEP_ALIVE_S,
            proxy_headers=False,  # the application reads them
            timeout_graceful_shutdown=GRACE_S,
        )
        super().__init__(config)
        self._feed = app.state.feed
        self._health = None if health is None else HealthServer(health, app.state.readiness)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Begin to serve; health checks are answered from then on."""
        await super().startup(sockets)
        if self._health is not None:
            self._health.start(asyncio.get_running_loop())

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """End event streams, then stop as uvicorn does."""
        self._feed.close()
        super().handle_exit(sig, frame)


def status_of() -> int:
    """Serve, and return the exit code."""
    try:
        return main()
    except SystemExit as end:
        return int(end.code or 0)


if __name__ == "__main__":
    # Requests whose work still runs in a thread were answered; the work ends with this process.
    end_now(status_of())
