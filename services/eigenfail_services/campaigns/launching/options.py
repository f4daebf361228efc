"""Options of the services' command line about workers."""

import argparse
from collections.abc import Callable

from eigenfail.hosting.span import refuse_scaling, span_of
from eigenfail_services.campaigns.launching.launcher import NoLauncher, WorkerLauncher
from eigenfail_services.campaigns.launching.ray_launcher import RayLauncher


def ray_launcher(arguments: argparse.Namespace) -> WorkerLauncher:
    """Return a launcher that has Ray start the workers.

    Raises:
        InvalidValue: the numbers of workers do not go together.
    """
    least, most = arguments.min_workers, arguments.max_workers
    span = span_of(arguments.workers, least, most, arguments.idle_s)
    return RayLauncher(span, arguments.ray_address)


def no_launcher(arguments: argparse.Namespace) -> WorkerLauncher:
    """Return a launcher that starts no workers.

    Raises:
        InvalidValue: numbers of workers are given that somebody would have to see to.
    """
    refuse_scaling(arguments.min_workers, arguments.max_workers, arguments.idle_s)
    return NoLauncher()


LAUNCHERS: dict[str, Callable[[argparse.Namespace], WorkerLauncher]] = {
    "ray": ray_launcher,
    "none": no_launcher,
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options for the number of workers and their launcher."""
    parser.add_argument("--workers", type=int, help="number of workers; default: one per core")
    parser.add_argument("--min-workers", type=int, help="number of idle workers to keep running; 0")
    parser.add_argument("--max-workers", type=int, help="scale with the work, up to this number")
    parser.add_argument(
        "--idle-s", type=float, help="time after which idle workers are stopped [s]; 60"
    )
    parser.add_argument("--launcher", choices=LAUNCHERS, default="ray")
    parser.add_argument("--ray-address", default=None, help="of a running cluster")


def create_launcher(arguments: argparse.Namespace) -> WorkerLauncher:
    """Return the launcher that the options name.

    Raises:
        InvalidValue: the numbers of workers do not go together.
    """
    return LAUNCHERS[arguments.launcher](arguments)
