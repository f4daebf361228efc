"""`eigenfail.local()`: a service of one's own, without a command line."""

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

    Whatever ends this process, a killed kernel of a notebook too, ends the service with it.

    Args:
        data: folder of its database and logs, kept afterwards; None takes a temporary one.
        workers: how many; 0 is one per core.
        port: port of its dashboard and API; 0 is any free one.
        launcher: starts the workers: `local`, as processes of the service; `ray`; or `none` where
            they are started by hand.
        planners: planners of one's own, as "module:Class" by the name that campaigns give; so they
            need not be installed. The modules are found where this process finds them.

    Raises:
        UnknownName: there is no such launcher.
        InvalidValue: there are fewer than 0 workers, or planners have no names.
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
        """Where its dashboard and API are.

        Raises:
            ServiceError: it does not run.
        """
        return self._running().address.url

    def start(self) -> Client:
        """Start it; a client of it.

        Raises:
            PortTaken: something else listens there.
            StoreUnavailable: the data folder cannot be written.
            InvalidValue: a planner's name is taken, or there is nothing at its place.
            ServiceError: it runs already, a part is not installed, or did not come up.
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
        """Stop the service and all of its processes; later calls have no effect."""
        atexit.unregister(self.stop)
        self._service = None
        self._stack.close()

    def check(self) -> None:
        """Make sure that it is well.

        Raises:
            ServiceError: it does not run, or one of its processes has ended.
        """
        self._running().check()

    def __repr__(self) -> str:
        """Whether it runs, and where."""
        return f"<Local: {self.url if self._service else 'does not run'}>"

    def __enter__(self) -> Client:
        """Start it."""
        return self.start()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End it."""
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
