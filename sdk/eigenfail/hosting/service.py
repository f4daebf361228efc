"""A complete service on this machine: controller and services as processes, on a data folder.

Plug-ins that are not installed are registered in a separate folder, for one service only.
"""

import os
import socket
import sys
import sysconfig
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import msgspec

from eigenfail import plugins
from eigenfail.client import Client
from eigenfail.errors import InvalidValue, PortTaken, ServiceError
from eigenfail.files import make_private_folder, open_private
from eigenfail.hosting import processes
from eigenfail.hosting.folder import HOST, Address, DataFolder
from eigenfail.progress import announce

IDLE_S = 60.0


LONGEST_IDLE_S = 86_400.0


class Span(msgspec.Struct, frozen=True):
    """Range for the number of workers, and the delay before idle workers are stopped.

    Attributes:
        least: minimum number of workers, idle ones included.
        most: maximum number of workers.
        idle_s: how long fewer workers must have been enough before one is stopped. [s]
    """

    least: int
    most: int
    idle_s: float = IDLE_S

    def options(self) -> tuple[str, ...]:
        """Return the options of the services' command line."""
        if self.least == self.most:
            return ("--workers", str(self.most))
        bounds = ("--min-workers", str(self.least), "--max-workers", str(self.most))
        return (*bounds, "--idle-s", f"{self.idle_s:g}")


def make_span(
    workers: int | None, least: int | None, most: int | None, idle_s: float | None
) -> Span:
    """Return the range of the number of workers: one number twice, unless `most` is given.

    Args:
        workers: fixed number of workers; None is one per core.
        least: smallest number of workers, if the number follows the work; None is 0.
        most: largest number of workers; None: the number does not follow the work.
        idle_s: how long fewer workers must have been enough; None is a minute. [s]

    Raises:
        InvalidValue: the numbers exclude each other, or are out of range.
    """
    if most is None:
        _refuse_half(least, idle_s)
        n = (os.cpu_count() or 1) if workers is None else workers
        if n < 0:
            raise InvalidValue("--workers", f"{n} is below 0.")
        return Span(n, n)
    if workers is not None:
        problem = "sets a fixed number of workers and cannot be combined with --max-workers."
        raise InvalidValue("--workers", problem, "Use only one of them.")
    return _make_scaled(least or 0, most, IDLE_S if idle_s is None else idle_s)


def _refuse_half(least: int | None, idle_s: float | None) -> None:
    """Raise InvalidValue if a bound of scaling is given without a largest number of workers."""
    for option, given in (("--min-workers", least), ("--idle-s", idle_s)):
        if given is not None:
            remedy = "Add --max-workers; --workers sets a fixed number."
            raise InvalidValue(option, "requires automatic scaling, which is off.", remedy)


def refuse_scaling(least: int | None, most: int | None, idle_s: float | None) -> None:
    """Raise InvalidValue if workers are to scale, but this service does not start any."""
    for option, given in (("--max-workers", most), ("--min-workers", least), ("--idle-s", idle_s)):
        if given is not None:
            remedy = f"Omit {option}, or have workers started: --launcher ray or local."
            raise InvalidValue(option, "scales workers, and --launcher none starts none.", remedy)


def _make_scaled(least: int, most: int, idle_s: float) -> Span:
    """Return the span with the given bounds.

    Raises:
        InvalidValue: the bounds are not a valid range.
    """
    if not 0 <= least <= most:
        problem = f"{least} is not between 0 and --max-workers, which is {most}."
        raise InvalidValue("--min-workers", problem)
    if not 0.0 < idle_s <= LONGEST_IDLE_S:
        problem = f"{idle_s:g} is not above 0 and at most {LONGEST_IDLE_S:g} seconds."
        raise InvalidValue("--idle-s", problem)
    return Span(least, most, idle_s)


METADATA = "Metadata-Version: 2.1\nName: eigenfail-homemade\nVersion: 0.0\n"


NAME = "eigenfail_homemade-0.0.dist-info"


INSTALLED = frozenset(Path(folder) for folder in sysconfig.get_paths().values())
"""Where every process of this Python looks anyway."""


READY_WITHIN_S = 90.0


NEEDED_MODULES = ("fastapi", "sqlalchemy", "torch", "zmq")


class Launcher(StrEnum):
    """Launcher of the workers: Ray, the service itself on this machine, or users by hand."""

    RAY = "ray"
    LOCAL = "local"
    NONE = "none"


class Ready(msgspec.Struct, frozen=True):
    """The message that the services process prints once it serves."""

    ready: bool
    hub: str


@dataclass(frozen=True)
class Plan:
    """The parts to start and their addresses; port 0 is any free one, 0 workers are one per core.

    Attributes:
        span: range of the number of workers, which follows the work; None for a fixed number.
        path: folders with plug-ins that are not installed, for imports by its processes.
    """

    data: Path
    port: int
    workers: int = 0
    launcher: Launcher = Launcher.LOCAL
    hub_port: int = 0
    span: Span | None = None
    path: tuple[Path, ...] = ()


@dataclass(frozen=True)
class LocalService:
    """A running service."""

    address: Address
    parts: tuple[processes.ServicePart, ...]

    def check(self) -> None:
        """Raise ServiceError if one of its processes has ended."""
        for part in self.parts:
            part.check()


@contextmanager
def local_service(plan: Plan) -> Iterator[LocalService]:
    """Run a service for as long as the block lasts; no process of it is left afterwards.

    Raises:
        PortTaken: another process listens on a port.
        StoreUnavailable: the data folder cannot be written.
        ServiceError: a part is not installed, or did not start.
    """
    require_installed()
    folder = DataFolder(plan.data)
    owner = str(folder.path)
    if folder.address() is None:
        choose_ports(plan)  # a port that is taken is said before the folder is made
    with folder.claimed(), processes.guard_owner(owner):
        processes.kill_marked(owner)  # those that remain where the guard was killed, too
        port, hub_port = choose_ports(plan)
        parts: list[processes.ServicePart] = []
        try:
            for name, command in make_commands(plan, folder.database, port, hub_port).items():
                found = _extend_python_path(plan.path)
                parts.append(processes.ServicePart(name, command, folder.log(name), owner, found))
            service = LocalService(wait_until_ready(parts, port), tuple(parts))
            folder.publish(service.address)
            with processes.rotate_regularly([part.rotate for part in parts]):
                yield service
        finally:
            processes.stop_parts(parts, owner)


def make_commands(plan: Plan, database: str, port: int, hub_port: int) -> dict[str, list[str]]:
    """Return the command line of each part."""
    python = (sys.executable, "-m")
    controller = ("--host", HOST, "--port", str(port))
    span = plan.span or make_span(plan.workers or None, None, None, None)
    services = (*span.options(), "--launcher", plan.launcher.value)
    keys = DataFolder(plan.data).hub_keys
    # The hub requires keys if its folder has some.
    locked = ("--hub-keys", str(keys)) if keys.exists() else ()
    hub = ("--hub", f"tcp://{HOST}:{hub_port}", *locked)
    return {
        "controller": [*python, "eigenfail_api", "--database", database, *controller],
        "services": [*python, "eigenfail_services", "--database", database, *services, *hub],
    }


def require_installed() -> None:
    """Raise ServiceError if only the client is installed."""
    missing = [name for name in NEEDED_MODULES if find_spec(name) is None]
    if missing:
        raise ServiceError(
            f"The service is not installed here: {', '.join(missing)} missing.",
            "Run in a clone: pip install '.[server,worker]'; or use a service elsewhere: "
            "eigenfail.Client(url) (on the command line --url).",
        )


def choose_ports(plan: Plan) -> tuple[int, int]:
    """Return the ports of the controller and of the hub; 0 is replaced by any free port.

    Raises:
        PortTaken: another process listens on a port.
    """
    return _bind_port(plan.port, "port"), _bind_port(plan.hub_port, "hub-port")


def _bind_port(port: int, name: str) -> int:
    with socket.socket() as probe:
        # As servers do: connections that closed a moment ago do not keep a port.
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError as error:
            raise PortTaken(
                f"Port {port} on {HOST} cannot be used: {error.strerror}.",
                "Stop the process that uses it, such as the service of another data folder, or "
                f"choose another port: {name.replace('-', '_')}=… (on the command line --{name}).",
            ) from error
        return int(probe.getsockname()[1])


def load_database_tool(name: str) -> Any:
    """Return a function of the server's package that works on a database without a service.

    Raises:
        ServiceError: the service is not installed here.
    """
    require_installed()
    return plugins.load(plugins.DATABASE_TOOLS, name)


def wait_until_ready(parts: Sequence[processes.ServicePart], port: int) -> Address:
    """Wait until the controller answers and the services report that they serve.

    Raises:
        ServiceError: a part ended, or is not ready in time.
    """
    # In the order of `make_commands`.
    controller, services = parts
    url = f"http://{HOST}:{port}"
    deadline = time.monotonic() + READY_WITHIN_S
    with Client(url) as client, announce("Starting the service"):
        while time.monotonic() < deadline:
            for part in parts:
                part.check()
            # The two start side by side, and either may be the later one.
            ready = find_ready_line(services.said())
            if ready and client.health():
                return Address(url, ready.hub)
            time.sleep(processes.POLL_S)
    raise ServiceError(
        f"The service was not ready after {READY_WITHIN_S:.0f} s.",
        f"Check {controller.log} and {services.log}.",
    )


def find_ready_line(lines: Sequence[str]) -> Ready | None:
    """Return the message that the services are ready; None if no line holds it."""
    for line in lines:
        try:
            # All other lines are those of the log.
            return msgspec.json.decode(line, type=Ready)
        except msgspec.DecodeError:
            continue
    return None


def register_planners(folder: Path, planners: Mapping[str, str]) -> tuple[Path, ...]:
    """Register planners in a folder, and return the folders that a service must import from.

    Args:
        folder: folder to write to.
        planners: module:Class by the name that campaigns give. Modules are found as in this
            process; code that is not in a file is refused.

    Raises:
        InvalidValue: a name is taken, or the class does not exist.
    """
    if not planners:
        return ()
    for name, place in planners.items():
        if not name.isidentifier() or name in plugins.names(plugins.PLANNERS):
            remedy = "Choose another name, of letters, digits and underscores."
            raise InvalidValue("planners", f"'{name}' is not a valid name, or is in use.", remedy)
        # A mistake shows here, and not in the log of a worker.
        plugins.load_class(place)
    listed = "\n".join(f"{name} = {place}" for name, place in planners.items())
    notes = folder / NAME
    make_private_folder(notes)
    texts = {"METADATA": METADATA, "entry_points.txt": f"[{plugins.PLANNERS}]\n{listed}\n"}
    for name, text in texts.items():
        with open_private(notes / name, "wb") as file:
            file.write(text.encode())
    homes = {_find_home(place) for place in planners.values()} - {Path.cwd(), *INSTALLED}
    return folder, Path.cwd(), *sorted(homes)


def _find_home(place: str) -> Path:
    """Return the folder that contains the module of a loaded module:Class.

    Raises:
        InvalidValue: another process cannot import it, such as a class in a notebook's cell.
    """
    module = place.partition(":")[0]
    spec = sys.modules[module].__spec__
    if module == "__main__" or spec is None or not spec.has_location:
        remedy = "Write the class to a file, such as my_planner.py, and name my_planner:MyPlanner."
        raise InvalidValue("planners", f"no service can import '{place}'.", remedy)
    depth = module.count(".") + bool(spec.submodule_search_locations)
    return Path(str(spec.origin)).absolute().parents[depth]


def _extend_python_path(folders: tuple[Path, ...]) -> dict[str, str]:
    """Return the environment variable that adds folders to a process's import path."""
    if not folders:
        return {}
    before = os.environ.get("PYTHONPATH", "")
    return {"PYTHONPATH": os.pathsep.join(filter(None, [*map(str, folders), before]))}
