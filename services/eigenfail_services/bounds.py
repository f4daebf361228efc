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
"""A learner with torch takes 300 MiB before its first step, an analysis 350 MiB in all."""

CONTAINERS_LIMIT = Path("/sys/fs/cgroup/memory.max")


class Bounds(msgspec.Struct, frozen=True):
    """Of one process.

    Attributes:
        time_s: over one step of a learner, or over an analysis. [s]
        memory_mib: of its own data, touched or not: RLIMIT_DATA. With torch on a processor that is
            within a few tens of MiB of what it has in memory, where RLIMIT_AS would count twice
            as much. [MiB]
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


NO_BOUNDS = Bounds(inf)


def half_of_the_memory_mib(containers_limit: Path = CONTAINERS_LIMIT) -> float:
    """Half of what the machine has, or the container: one that runs wild leaves the rest alone.

    Never less than `LEAST_MIB`.
    """
    most = psutil.virtual_memory().total
    with contextlib.suppress(OSError, ValueError):  # there is no such file, or it says "max"
        most = min(most, int(containers_limit.read_text()))
    return max(float(most // MIB // 2), LEAST_MIB)


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
    raise argparse.ArgumentTypeError(f"'{text}' is no number above 0; 'inf' is no limit at all")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options, with the environment behind them."""
    for option, variable, default, words in (
        ("--learner-limit", LEARNER_LIMIT, HOUR_S, "over one step of a learner [s]"),
        ("--analysis-limit", ANALYSIS_LIMIT, HOUR_S, "over an analysis [s]"),
        ("--learner-memory", LEARNER_MEMORY, half_of_the_memory_mib(), "of either of them [MiB]"),
    ):
        given = os.environ.get(variable) or str(default)
        parser.add_argument(option, type=positive, default=given, help=words)


def of_learners(arguments: argparse.Namespace) -> Bounds:
    """What the command line allows a learner."""
    return Bounds(arguments.learner_limit, arguments.learner_memory)


def of_analyses(arguments: argparse.Namespace) -> Bounds:
    """What the command line allows an analysis."""
    return Bounds(arguments.analysis_limit, arguments.learner_memory)
