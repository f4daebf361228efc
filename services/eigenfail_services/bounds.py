"""What the process of a learner, or of an analysis, may take of the machine."""

import argparse
import contextlib
import os
import resource
import sys
from math import inf
from pathlib import Path

import msgspec
import psutil

HOUR_S = 3_600.0
LEARNER_LIMIT = "EIGENFAIL_LEARNER_LIMIT_S"
ANALYSIS_LIMIT = "EIGENFAIL_ANALYSIS_LIMIT_S"
LEARNER_MEMORY = "EIGENFAIL_LEARNER_MEMORY_MIB"

MIB = 1024 * 1024
LEAST_MIB = 1024.0
"""A learner with torch takes `LEARNER_MIB` before its first step, an analysis 350 MiB in all."""

CAMPAIGNS = "EIGENFAIL_CAMPAIGNS"
SOME_CAMPAIGNS = 4
LEARNER_MIB = 300.0
"""What a learner with torch takes before its first step."""

CONTAINERS_LIMIT = Path("/sys/fs/cgroup/memory.max")


class SettingBounds(msgspec.Struct, frozen=True):
    """Of one process.

    Attributes:
        time_s: over one step of a learner, or over an analysis. [s]
        memory_mib: limit of the process's own data, touched or not: RLIMIT_DATA. With torch on a
            processor that is within a few tens of MiB of what it has in memory, where RLIMIT_AS
            would count twice as much. [MiB]
    """

    time_s: float
    memory_mib: float = inf

    def confine(self, pid: int) -> None:
        """Have the kernel refuse more memory to a process, and to each that it starts (Linux).

        A lower limit of the service's own, which only an administrator may raise, stays.
        """
        if sys.platform == "linux" and self.memory_mib < inf:
            most = int(self.memory_mib * MIB)
            with contextlib.suppress(OSError):  # it has ended, or may not be confined
                _, hard = resource.prlimit(pid, resource.RLIMIT_DATA)
                most = most if hard == resource.RLIM_INFINITY else min(most, hard)
                resource.prlimit(pid, resource.RLIMIT_DATA, (most, most))


NO_BOUNDS = SettingBounds(inf)


def half_of_the_memory_mib(containers_limit: Path = CONTAINERS_LIMIT) -> float:
    """Half of what the machine has, or the container: one that runs wild leaves the rest alone.

    Never less than `LEAST_MIB`.
    """
    return max(memory_mib(containers_limit) // 2, LEAST_MIB)


def memory_mib(containers_limit: Path = CONTAINERS_LIMIT) -> float:
    """What the machine has, or the container."""
    most = psutil.virtual_memory().total
    with contextlib.suppress(OSError, ValueError):  # there is no such file, or it says "max"
        most = min(most, int(containers_limit.read_text()))
    return float(most // MIB)


def most_campaigns(memory_mib: float) -> int:
    """Return the number of learners that fit into a memory before their first step; at least 1."""
    return max(1, int(memory_mib // LEARNER_MIB))


def campaigns_at_once(text: str) -> int:
    """How many campaigns run at a time, as the command line has it.

    Raises:
        ArgumentTypeError: it is no whole number above 0, or their learners have no room here.
    """
    most = most_campaigns(memory_mib())
    if not (text.isdecimal() and text.isascii() and int(text[:9])):
        raise argparse.ArgumentTypeError(f"'{text[:20]}' is not an integer above 0")
    if int(text[:9]) > most:
        needs = f"a learner takes {LEARNER_MIB:g} MiB before its first step"
        raise argparse.ArgumentTypeError(f"{text[:9]} are too many here, at most {most}: {needs}")
    return int(text[:9])


def positive(text: str) -> float:
    """A limit, as the command line has it.

    Raises:
        ArgumentTypeError: it is no number above 0.
    """
    try:
        limit = float(text)
    except ValueError:
        limit = 0.0
    if limit > 0.0:
        return limit
    raise argparse.ArgumentTypeError(f"'{text}' is not a number above 0; 'inf' is no limit at all")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options, with the environment behind them."""
    for option, variable, default, words in (
        ("--learner-limit", LEARNER_LIMIT, HOUR_S, "over one step of a learner [s]"),
        ("--analysis-limit", ANALYSIS_LIMIT, HOUR_S, "over an analysis [s]"),
        ("--learner-memory", LEARNER_MEMORY, half_of_the_memory_mib(), "of either of them [MiB]"),
    ):
        given = os.environ.get(variable) or str(default)
        parser.add_argument(option, type=positive, default=given, help=words)
    parser.add_argument(
        "--campaigns",
        type=campaigns_at_once,
        default=os.environ.get(CAMPAIGNS) or str(min(SOME_CAMPAIGNS, most_campaigns(memory_mib()))),
        help="how many run at a time, each with a learner of its own",
    )


def of_learners(arguments: argparse.Namespace) -> SettingBounds:
    """What the command line allows a learner."""
    return SettingBounds(arguments.learner_limit, arguments.learner_memory)


def of_analyses(arguments: argparse.Namespace) -> SettingBounds:
    """What the command line allows an analysis."""
    return SettingBounds(arguments.analysis_limit, arguments.learner_memory)
