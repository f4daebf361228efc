"""The options of the services' command line, and the launcher of workers that they choose.

Each option is declared once, with its environment variable.
"""

import argparse
import os
from collections.abc import Callable, Mapping
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

from eigenfail.errors import InvalidValue
from eigenfail.hosting.service import Launcher, make_span, refuse_scaling
from eigenfail_services import bounds, observability
from eigenfail_services.campaigns.analysis_jobs import DATABASE_VARIABLE
from eigenfail_services.campaigns.launcher import NoLauncher, WorkerLauncher
from eigenfail_services.campaigns.process_launcher import ProcessLauncher
from eigenfail_services.campaigns.ray_launcher import RayLauncher
from eigenfail_services.hub.transport import KEYS_VARIABLE


def read_campaigns(text: str) -> int:
    """Return the number of campaigns that run at a time.

    Raises:
        ArgumentTypeError: it is not a whole number above 0, or so many learners do not fit into
            memory.
    """
    most = bounds.count_fitting_learners(bounds.memory_mib())
    # Nine digits are enough to be too many, and Python refuses to convert thousands of them.
    if not (text.isdecimal() and text.isascii() and int(text[:9])):
        raise argparse.ArgumentTypeError(f"'{text[:20]}' is not an integer above 0")
    if int(text[:9]) > most:
        needs = f"a learner takes {bounds.LEARNER_MIB:g} MiB before its first step"
        raise argparse.ArgumentTypeError(f"{text[:9]} are too many here, at most {most}: {needs}")
    return int(text[:9])


def read_limit(text: str) -> float:
    """Return a limit; `inf` means unlimited.

    Raises:
        ArgumentTypeError: it is not a number above 0.
    """
    try:
        limit = float(text)
    except ValueError:
        limit = 0.0
    # Not `<= 0.0`, which a NaN would pass.
    if not 0.0 < limit <= inf:
        raise argparse.ArgumentTypeError(
            f"'{text}' is not a number above 0; 'inf' is no limit at all"
        )
    return limit


class Option(NamedTuple):
    """An option of the command line.

    Attributes:
        help: what `--help` says.
        variable: environment variable that applies if the option is not given.
        default: value if neither is given; a function finds it on this machine. Texts are read
            as if they were given.
        read: returns the value of a text, or raises ValueError or ArgumentTypeError.
        choices: the texts that are allowed; empty for any.
    """

    help: str
    variable: str = ""
    default: str | Callable[[], str] | None = None
    read: Callable[[str], Any] = str
    choices: tuple[str, ...] = ()


OPTIONS: Mapping[str, Option] = {
    "--database": Option("URL", DATABASE_VARIABLE, ""),
    "--hub": Option("address to listen on", default="tcp://127.0.0.1:*"),
    "--advertise": Option("the hub's address, as workers of Ray reach it"),
    "--hub-keys": Option("folder of its keys", KEYS_VARIABLE, read=Path),
    "--workers": Option("number of workers; default: one per core", read=int),
    "--min-workers": Option("minimum number of workers; 0", read=int),
    "--max-workers": Option("scale with the work, up to this number", read=int),
    "--idle-s": Option("time after which idle workers are stopped [s]; 60", read=float),
    "--launcher": Option(
        "what starts workers", default=Launcher.RAY.value, choices=tuple(map(str, Launcher))
    ),
    "--ray-address": Option("of a running cluster"),
    "--learner-limit": Option(
        "over one step of a learner [s]", bounds.LEARNER_LIMIT, str(bounds.HOUR_S), read_limit
    ),
    "--analysis-limit": Option(
        "over an analysis [s]", bounds.ANALYSIS_LIMIT, str(bounds.HOUR_S), read_limit
    ),
    "--learner-memory": Option(
        "of either of them [MiB]",
        bounds.LEARNER_MEMORY,
        lambda: str(bounds.half_of_the_memory_mib()),
        read_limit,
    ),
    "--campaigns": Option(
        "how many run at a time, each with a learner of its own",
        bounds.CAMPAIGNS,
        lambda: str(bounds.choose_campaigns()),
        read_campaigns,
    ),
    "--metrics": Option("host:port where Prometheus may scrape", observability.VARIABLE, ""),
}


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options to a parser."""
    for name, option in OPTIONS.items():
        default = option.default() if callable(option.default) else option.default
        # A variable that is set to nothing is one that is not set, as in compose files.
        given = os.environ.get(option.variable) or default
        parser.add_argument(
            name,
            default=given,
            type=option.read,
            choices=option.choices or None,
            help=option.help,
        )


def create_launcher(arguments: argparse.Namespace) -> WorkerLauncher:
    """Return the launcher that the options name.

    Raises:
        InvalidValue: the numbers of workers are inconsistent, or are given to the launcher none; or
            a running Ray is given to the launcher local.
    """
    least, most, idle_s = arguments.min_workers, arguments.max_workers, arguments.idle_s
    launcher = Launcher(arguments.launcher)
    if launcher is Launcher.NONE:
        refuse_scaling(least, most, idle_s)
        return NoLauncher()
    if launcher is Launcher.LOCAL and arguments.ray_address is not None:
        problem = "names a running Ray, and --launcher local uses none."
        raise InvalidValue("--ray-address", problem, "Omit it, or take --launcher ray.")
    span = make_span(arguments.workers, least, most, idle_s)
    if launcher is Launcher.LOCAL:
        return ProcessLauncher(span)
    return RayLauncher(span, arguments.ray_address)
