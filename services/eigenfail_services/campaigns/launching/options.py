"""What the services' command line says of workers."""

import argparse
from collections.abc import Callable

from eigenfail.hosting.span import refuse_scaling, span_of
from eigenfail_services.campaigns.launching.launcher import Launcher, NoLauncher
from eigenfail_services.campaigns.launching.ray_launcher import RayLauncher


def ray_launcher(arguments: argparse.Namespace) -> Launcher:
    """Ray, for as many workers as there are to be.

    Raises:
        InvalidValue: the numbers of workers do not go together.
    """
    least, most = arguments.min_workers, arguments.max_workers
    span = span_of(arguments.workers, least, most, arguments.idle_s)
    return RayLauncher(span, arguments.ray_address)


def no_launcher(arguments: argparse.Namespace) -> Launcher:
    """Nobody.

    Raises:
        InvalidValue: numbers of workers are given that somebody would have to see to.
    """
    refuse_scaling(arguments.min_workers, arguments.max_workers, arguments.idle_s)
    return NoLauncher()


LAUNCHERS: dict[str, Callable[[argparse.Namespace], Launcher]] = {
    "ray": ray_launcher,
    "none": no_launcher,
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """How many workers there are to be, and who starts them."""
    parser.add_argument("--workers", type=int, help="just so many; without it, one per core")
    parser.add_argument("--min-workers", type=int, help="so many with nothing to do; 0")
    parser.add_argument("--max-workers", type=int, help="scale with the work, up to so many")
    parser.add_argument("--idle-s", type=float, help="workers not needed for so long go [s]; 60")
    parser.add_argument("--launcher", choices=LAUNCHERS, default="ray")
    parser.add_argument("--ray-address", default=None, help="of a running cluster")


def launcher_of(arguments: argparse.Namespace) -> Launcher:
    """Whoever starts the workers.

    Raises:
        InvalidValue: the numbers of workers do not go together.
    """
    return LAUNCHERS[arguments.launcher](arguments)
