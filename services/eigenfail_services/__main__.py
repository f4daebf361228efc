"""The services process: hub, supervisor and learners. `python -m eigenfail_services --help`."""

import argparse
import gc
import json
import signal
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from threading import Event, Thread
from typing import NoReturn

import structlog

from eigenfail import logs, plugins
from eigenfail.command_line import Parser, checked_stdout
from eigenfail.errors import EigenfailError, StoreUnavailable
from eigenfail.hosting.service import Launcher
from eigenfail.processes import die_with_parent, end_now
from eigenfail.values.access import redact
from eigenfail_services import observability, options
from eigenfail_services.bounds import SettingBounds
from eigenfail_services.campaigns import analysis_jobs
from eigenfail_services.campaigns.launcher import WorkerScaling
from eigenfail_services.campaigns.supervisor import Supervisor
from eigenfail_services.hub.server import Hub
from eigenfail_services.hub.transport import load_keys
from eigenfail_services.store.store import Store, open_store

TURN_S = 0.25
RETRY_S = 1.0
HUB_WAIT_S = 0.5
"""Time that a statement of the hub waits for another program's lock: workers wait as long for
an answer, and what could not be written is tried again."""

TASK_RETRY_S = 2.0
"""Pause before a task that broke off is started again: it must not fill the log."""

TASKS_STOP_S = 3.0
"""Time that all tasks together have to end. The process then ends without them. [s]"""

Task = Callable[[Store, Event], None]
"""What an entry point of `eigenfail.tasks` names: it returns soon after the event is set."""

log = structlog.get_logger()


class BackgroundTasks:
    """Runs the tasks of the installed plug-ins, one thread for each task.

    An error in a task is logged and ends nothing else: the service must work without plug-ins.
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
        until_s = time.monotonic() + TASKS_STOP_S
        for thread in self._threads:
            thread.join(max(0.0, until_s - time.monotonic()))

    def _run(self, name: str, task: Task) -> None:
        while not self._stopping.is_set():
            try:
                task(self._store, self._stopping)
            except Exception:
                log.exception("a task broke off and is started again", task=name)
                self._stopping.wait(TASK_RETRY_S)
            else:
                return


def parse(words: list[str] | None = None) -> argparse.Namespace:
    """Return the options and the command of the command line."""
    parser = Parser(prog="eigenfail_services", description=__doc__)
    parser.set_defaults(command=serve)
    options.add_options(parser)
    commands = parser.add_subparsers(title="commands")
    analyse = commands.add_parser("analyse", help="work on one analysis, then end")
    analyse.add_argument("analysis", type=int)
    analyse.set_defaults(command=analyse_one)
    return parser.parse_args(words)


def analyse_one(arguments: argparse.Namespace) -> NoReturn:
    """Run one analysis; the process dies if the supervisor that started it dies.

    The process ends with the analysis, even if a planner has left threads behind.
    """
    die_with_parent()
    end_now(status_of(arguments))


def status_of(arguments: argparse.Namespace) -> int:
    """Run the analysis, and return its exit code; problems go to standard error."""
    try:
        # The service made the database; where it is gone since, nothing may take its place.
        store = open_store(arguments.database, migrate=False)
        analysis_jobs.run_analysis(store, arguments.analysis)
        store.close()
    except EigenfailError as error:
        return _complain(error)
    except Exception:
        log.exception("analysis broke off", analysis=arguments.analysis)
        return 1
    return 0


def serve(arguments: argparse.Namespace) -> None:
    """Run hub, supervisor and workers until SIGTERM or Ctrl-C."""
    keys, launcher = (
        load_keys(arguments.hub, arguments.hub_keys),
        options.create_launcher(arguments),
    )
    stopping = Event()
    # From here on a signal asks for an orderly end, so that nothing that is started below is left
    # behind.
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stopping.set())
    store = open_store(arguments.database)
    # The hub waits only briefly for a lock: workers wait for its answers.
    hub_store = open_store(arguments.database, wait_s=HUB_WAIT_S)
    of_learners = SettingBounds(arguments.learner_limit, arguments.learner_memory)
    of_analyses = SettingBounds(arguments.analysis_limit, arguments.learner_memory)
    hub = Hub(hub_store, arguments.hub, keys, of_learners)
    analyses = analysis_jobs.AnalysisJobs(store, arguments.database, of_analyses)
    supervisor = Supervisor(store, hub, analyses, arguments.campaigns)
    staffing = WorkerScaling(launcher, hub, store.events)
    tasks = BackgroundTasks(store)
    with ExitStack() as endings:  # the last one first, and each of them whatever the others meet
        endings.callback(observability.configure("services"))
        # In the end the hub stops first, so that no result arrives any more. Then claims are given
        # back, workers leave, and the stores are closed last.
        stores = (store.close, hub_store.close)
        parts = (launcher.stop, analyses.stop, supervisor.release, hub.stop)
        for ending in (*stores, tasks.stop, *parts):
            endings.callback(ending)
        if arguments.metrics:
            endings.callback(observability.serve(arguments.metrics, hub.metrics.registry))
        gc.freeze()  # all that is loaded by now stays: looking through it would hold up the hub
        hub.start()
        tasks.start()
        is_local = arguments.launcher == Launcher.LOCAL
        reached = hub.address if is_local else arguments.advertise or hub.address
        # "own" is what the log calls the key of the workers that the service starts itself.
        launcher.start(reached, keys.create_own("own") if keys else None, stopping.is_set)
        # Whoever starts the services reads in this line that they are ready, and where the hub is.
        if not stopping.is_set():
            sys.stdout.write(json.dumps({"ready": True, "hub": hub.address}) + "\n")
            sys.stdout.flush()
        supervise(supervisor, staffing, hub, stopping)
    for number in (signal.SIGTERM, signal.SIGINT):  # as the interpreter ends, one more would kill
        signal.signal(number, signal.SIG_IGN)


def supervise(supervisor: Supervisor, staffing: WorkerScaling, hub: Hub, stopping: Event) -> None:
    """Run turns until a signal stops the process or the hub has ended."""
    while not stopping.wait(TURN_S):
        for turn in (supervisor.turn, staffing.turn):  # each of them whatever the other meets
            try:
                turn()
            except StoreUnavailable as error:
                log.warning("store unavailable", problem=str(error))
                time.sleep(RETRY_S)
        # Without a hub the supervisor would claim jobs that nothing here runs.
        if not hub.is_alive():
            raise EigenfailError("The hub's thread has died.", "Its log says why; start again.")


def main() -> None:
    """Run the command; an error is one sentence and an exit code."""
    arguments = parse()
    try:
        logs.configure("services")
        with checked_stdout():
            arguments.command(arguments)
    except EigenfailError as error:
        sys.exit(_complain(error))


def _complain(error: EigenfailError) -> int:
    sys.stderr.write(redact(f"{error}\n"))
    return error.exit_code


if __name__ == "__main__":
    main()
