"""Background tasks of the services: what plug-ins do while a service runs."""

import time
from collections.abc import Callable
from threading import Event, Thread

import structlog

from eigenfail import plugins
from eigenfail.errors import EigenfailError
from eigenfail_services.store.store import Store

RETRY_S = 2.0
"""Pause before a task that broke off is started again: it must not fill the log."""

STOP_S = 3.0
"""Time that all tasks together have to end. The process then ends without them. [s]"""

Task = Callable[[Store, Event], None]
"""What an entry point of `eigenfail.tasks` names: it returns soon after the event is set."""

log = structlog.get_logger()


class BackgroundTasks:
    """Runs the tasks of the installed plug-ins, each in a thread of its own.

    Whatever a task meets is logged and ends nothing else: the service must work without plug-ins.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._stopping = Event()
        self._threads: list[Thread] = []

    def start(self) -> None:
        """Start all tasks that can be loaded."""
        for name in plugins.names(plugins.TASKS):
            try:
                task = plugins.load(plugins.TASKS, name)
            except EigenfailError:
                log.exception("a task is left out", task=name)
                continue
            # A task that does not end must not keep the process alive.
            thread = Thread(target=self._run, args=(name, task), name=name, daemon=True)
            thread.start()
            self._threads.append(thread)

    def stop(self) -> None:
        """Ask all tasks to end, and wait for them."""
        self._stopping.set()
        until_s = time.monotonic() + STOP_S
        for thread in self._threads:
            thread.join(max(0.0, until_s - time.monotonic()))

    def _run(self, name: str, task: Task) -> None:
        while not self._stopping.is_set():
            try:
                task(self._store, self._stopping)
            except Exception:
                log.exception("a task broke off and is started again", task=name)
                self._stopping.wait(RETRY_S)
            else:
                return
