"""`eigenfail.local()`: a private service, without a command line."""

import atexit
from collections.abc import Mapping
from contextlib import AbstractContextManager, ExitStack
from functools import partial
from pathlib import Path
from tempfile import mkdtemp
from types import TracebackType

from eigenfail.client import Client
from eigenfail.errors import InvalidValue, ServiceError, UnknownName
from eigenfail.hosting.processes import NOTHING, remove_afterwards
from eigenfail.hosting.service import (
    Launcher,
    LocalService,
    Plan,
    local_service,
    register_planners,
)


class Local(AbstractContextManager[Client]):
    """A service on this machine that ends with its block, with `stop`, or with this process.

    The service ends with this process in any case, for example if a notebook's kernel is killed.

    Args:
        data: folder of its database and logs, kept afterwards; None takes a temporary one.
        workers: number of workers; 0 is one per core.
        port: port of its dashboard and API; 0 is any free one.
        launcher: launcher of the workers: `local`, as processes of the service; `ray`; or `none` if
            you start them by hand.
        planners: your own planners, as "module:Class" by the name that campaigns give. They need
            not be installed; their modules are found as in this process.

    Raises:
        UnknownName: the launcher does not exist.
        InvalidValue: the number of workers is negative, or planners are given without names.
    """

    def __init__(
        self,
        data: Path | str | None = None,
        workers: int = 0,
        port: int = 0,
        launcher: Launcher | str = Launcher.LOCAL,
        planners: Mapping[str, str] = NOTHING,
    ) -> None:
        if workers < 0:
            raise InvalidValue("workers", f"{workers} is below 0.", "0 is one per core.")
        if launcher not in list(Launcher):
            raise UnknownName("launcher", str(launcher), Launcher)
        _check_planners(planners)
        self.data = None if data is None else Path(data)
        self._plan = partial(Plan, port=port, workers=workers, launcher=Launcher(launcher))
        self._planners = planners
        self._stack = ExitStack()
        self._service: LocalService | None = None

    @property
    def url(self) -> str:
        """Address of its dashboard and API.

        Raises:
            ServiceError: it does not run.
        """
        return self._running().address.url

    def start(self) -> Client:
        """Start the service, and return a client for it.

        Raises:
            PortTaken: another process listens on the port.
            StoreUnavailable: the data folder cannot be written.
            InvalidValue: a planner's name is taken, or its class does not exist.
            ServiceError: it runs already, a part is not installed, or did not start.
        """
        if self._service is not None:
            raise ServiceError(f"This service is already running at {self.url}.", "Use its client.")
        with ExitStack() as stack:
            data = self.data
            if data is None:
                data = Path(mkdtemp(prefix="eigenfail-"))
                stack.enter_context(remove_afterwards(data))
            path = register_planners(data / "plugins", self._planners)
            service = stack.enter_context(local_service(self._plan(data, path=path)))
            client = stack.enter_context(Client(service.address.url))
            # Only now may the service outlive this block: an error before ends all that was
            # started.
            self._service, self._stack = service, stack.pop_all()
        # At the usual end of a script; after any other end the guard does it.
        atexit.register(self.stop)
        return client

    def stop(self) -> None:
        """Stop the service and all of its processes; later calls do nothing."""
        atexit.unregister(self.stop)
        self._service = None
        self._stack.close()

    def check(self) -> None:
        """Check that the service and all of its processes run.

        Raises:
            ServiceError: it does not run, or one of its processes has ended.
        """
        self._running().check()

    def __repr__(self) -> str:
        """Return the class name with the address, or that it does not run."""
        return f"<Local: {self.url if self._service else 'does not run'}>"

    def __enter__(self) -> Client:
        """Start the service."""
        return self.start()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop the service."""
        self.stop()

    def _running(self) -> LocalService:
        if self._service is None:
            raise ServiceError(
                "This service is not running.", "Call start(), or use the object in a with block."
            )
        return self._service


def _check_planners(given: object) -> None:
    if not isinstance(given, Mapping):
        problem = f"a {type(given).__name__} does not give names to planners."
        raise InvalidValue("planners", problem, 'Use the form {"mine": "my_module:MyPlanner"}.')
