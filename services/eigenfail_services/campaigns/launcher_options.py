"""The options of the services' command line for workers: how many, and what starts them."""

import argparse
from collections.abc import Callable

from eigenfail.errors import InvalidValue
from eigenfail.hosting.service import Launcher, Span, make_span, refuse_scaling
from eigenfail_services.campaigns.launcher import NoLauncher, WorkerLauncher
from eigenfail_services.campaigns.process_launcher import ProcessLauncher
from eigenfail_services.campaigns.ray_launcher import RayLauncher


def make_ray_launcher(arguments: argparse.Namespace) -> WorkerLauncher:
    """Return a launcher that has Ray start the workers.

    Raises:
        InvalidValue: the numbers of workers do not go together.
    """
    return RayLauncher(_read_span(arguments), arguments.ray_address)


def make_process_launcher(arguments: argparse.Namespace) -> WorkerLauncher:
    """Return a launcher whose workers are processes of this machine.

    Raises:
        InvalidValue: the numbers of workers do not go together, or a cluster is named.
    """
    if arguments.ray_address is not None:
        problem = "names a running Ray, and --launcher local uses none."
        raise InvalidValue("--ray-address", problem, "Omit it, or take --launcher ray.")
    return ProcessLauncher(_read_span(arguments))


def _read_span(arguments: argparse.Namespace) -> Span:
    """Return the numbers of workers.

    Raises:
        InvalidValue: they do not go together.
    """
    least, most = arguments.min_workers, arguments.max_workers
    return make_span(arguments.workers, least, most, arguments.idle_s)


def make_no_launcher(arguments: argparse.Namespace) -> WorkerLauncher:
    """Return a launcher that starts no workers.

    Raises:
        InvalidValue: numbers of workers are given although none are started here.
    """
    refuse_scaling(arguments.min_workers, arguments.max_workers, arguments.idle_s)
    return NoLauncher()


LAUNCHERS: dict[Launcher, Callable[[argparse.Namespace], WorkerLauncher]] = {
    Launcher.RAY: make_ray_launcher,
    Launcher.LOCAL: make_process_launcher,
    Launcher.NONE: make_no_launcher,
}


def create_launcher(arguments: argparse.Namespace) -> WorkerLauncher:
    """Return the launcher that the options name.

    Raises:
        InvalidValue: the numbers of workers do not go together.
    """
    return LAUNCHERS[Launcher(arguments.launcher)](arguments)
