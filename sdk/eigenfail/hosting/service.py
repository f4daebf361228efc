"""A whole service on this machine: controller and services as processes, on a data folder."""

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from importlib.util import find_spec
from pathlib import Path

import msgspec

from eigenfail.client import Client
from eigenfail.errors import InputError, PortTaken, ServiceError
from eigenfail.hosting.folder import HOST, Address, DataFolder
from eigenfail.hosting.homemade import python_path
from eigenfail.hosting.logs import bounded
from eigenfail.hosting.processes import NOTHING, POLL_S, Part, end_marked, stop
from eigenfail.hosting.span import Span, span_of
from eigenfail.hosting.warden import warden

READY_WITHIN_S = 90.0
NEEDED_MODULES = ("fastapi", "sqlalchemy", "torch", "zmq")


class Launcher(StrEnum):
    """Who starts workers: Ray on this machine, or whoever calls `eigenfail worker`."""

    RAY = "ray"
    NONE = "none"


class Ready(msgspec.Struct, frozen=True):
    """What the services process says once it serves."""

    ready: bool
    hub: str


@dataclass(frozen=True)
class Plan:
    """What is to be started, and where: port 0 is any free one, 0 workers are one per core.

    Attributes:
        span: within which the number of workers follows the work, instead of a number that stays.
        path: folders from which its processes import plug-ins that are not installed.
    """

    data: Path
    port: int
    workers: int = 0
    launcher: Launcher = Launcher.RAY
    hub_port: int = 0
    span: Span | None = None
    path: tuple[Path, ...] = ()


@dataclass(frozen=True)
class LocalService:
    """A service that runs."""

    address: Address
    parts: tuple[Part, ...]

    def check(self) -> None:
        """Raises ServiceError if one of its processes has ended."""
        for part in self.parts:
            part.check()


@contextmanager
def local_service(plan: Plan) -> Iterator[LocalService]:
    """A service for as long as the block lasts; nothing of it is left afterwards.

    Raises:
        PortTaken: something else listens there.
        StoreUnavailable: the data folder cannot be written.
        ServiceError: a part is not installed, or did not come up.
    """
    require_installed()
    folder = DataFolder(plan.data)
    owner = str(folder.path)
    with folder.claimed(), warden(owner):
        end_marked(owner)  # left where the warden was killed, too
        port, hub_port = free_port(plan.port), free_port(plan.hub_port)
        parts: list[Part] = []
        try:
            for name, command in commands(plan, folder.database, port, hub_port).items():
                found = python_path(plan.path)
                parts.append(Part(name, command, folder.log(name), owner, found))
            service = LocalService(wait_until_ready(parts, port), tuple(parts))
            folder.publish(service.address)
            with bounded([part.rotate for part in parts]):
                yield service
        finally:
            stop(parts, owner)


def commands(plan: Plan, database: str, port: int, hub_port: int) -> dict[str, list[str]]:
    """The command line of each part."""
    python = (sys.executable, "-m")
    controller = ("--host", HOST, "--port", str(port))
    span = plan.span or span_of(plan.workers or None, None, None, None)
    services = (*span.options(), "--launcher", plan.launcher.value)
    hub = ("--hub", f"tcp://{HOST}:{hub_port}", *hub_keys(DataFolder(plan.data)))
    return {
        "controller": [*python, "eigenfail_api", "--database", database, *controller],
        "services": [*python, "eigenfail_services", "--database", database, *services, *hub],
    }


def hub_keys(folder: DataFolder) -> tuple[str, ...]:
    """What makes the hub ask for keys: somebody made some in its folder."""
    return ("--hub-keys", str(folder.hub_keys)) if folder.hub_keys.exists() else ()


def require_installed() -> None:
    """Raises ServiceError if this is the bare client."""
    missing = [name for name in NEEDED_MODULES if find_spec(name) is None]
    if missing:
        raise ServiceError(
            f"The service is not installed here: {', '.join(missing)} missing.",
            "Run: pip install 'eigenfail[server,worker]'; or use a service elsewhere with --url.",
        )


def free_port(port: int) -> int:
    """The port, or any free one for 0.

    Raises:
        PortTaken: something else listens there.
    """
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError as error:
            raise PortTaken(
                f"Port {port} on {HOST} cannot be used: {error.strerror}.",
                "Stop what listens there, or choose another with --port.",
            ) from error
        return int(probe.getsockname()[1])


def database_tool(action: str, database: str, *options: str) -> str:
    """What `python -m eigenfail_services db` says.

    Raises:
        InputError: what was asked for cannot be done as asked.
        ServiceError: it fails.
    """
    return services_tool(("db", action, *options), database)


def services_tool(words: Sequence[str], database: str) -> str:
    """What a command of `python -m eigenfail_services` says, that works on a database and ends.

    Raises:
        InputError: what was asked for cannot be done as asked.
        ServiceError: it fails.
    """
    # Not an argument: everybody on the machine can read those, and there may be a password in it.
    return services_program(words, {"EIGENFAIL_DATABASE": database})


def services_program(words: Sequence[str], variables: Mapping[str, str] = NOTHING) -> str:
    """What a command of `python -m eigenfail_services` says that ends by itself.

    Raises:
        InputError: what was asked for cannot be done as asked.
        ServiceError: it fails.
    """
    command = [sys.executable, "-m", "eigenfail_services", *words]
    environment = os.environ | dict(variables)
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    if done.returncode:
        said = done.stderr.strip() or f"The services' program failed at '{' '.join(words[:2])}'."
        if done.returncode == InputError.exit_code:
            raise InputError("", said)
        raise ServiceError(said)
    return done.stdout.strip()


def wait_until_ready(parts: Sequence[Part], port: int) -> Address:
    """Wait until the controller answers and the services say that they serve.

    Raises:
        ServiceError: a part ended, or is not ready in time.
    """
    controller, services = parts
    url = f"http://{HOST}:{port}"
    deadline = time.monotonic() + READY_WITHIN_S
    with Client(url) as client:
        while time.monotonic() < deadline:
            for part in parts:
                part.check()
            ready = ready_line(services.said())
            if ready and client.health():
                return Address(url, ready.hub)
            time.sleep(POLL_S)
    raise ServiceError(
        f"The service was not ready after {READY_WITHIN_S:.0f} s.",
        f"Look into {controller.log} and {services.log}.",
    )


def ready_line(lines: Sequence[str]) -> Ready | None:
    """The line by which the services say that they serve."""
    for line in lines:
        try:
            return msgspec.json.decode(line, type=Ready)
        except msgspec.DecodeError:
            continue
    return None
