"""Limits on the time and memory of learners and analyses."""

import contextlib
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
"""Memory of a learner with torch before its first step. [MiB]"""

CONTAINERS_LIMIT = Path("/sys/fs/cgroup/memory.max")


class SettingBounds(msgspec.Struct, frozen=True):
    """Limits of one process.

    Attributes:
        time_s: limit for one step of a learner, or for an analysis. [s]
        memory_mib: limit of the process's own data, touched or not: RLIMIT_DATA. With torch on a
            CPU, this count is within a few tens of MiB of the memory in use; RLIMIT_AS would count
            twice as much. [MiB]
    """

    time_s: float
    memory_mib: float = inf

    def confine(self, pid: int) -> None:
        """Have the kernel refuse more memory to a process, and to each that it starts (Linux).

        If the service itself has a lower limit, which only an administrator may raise, it stays.
        """
        if sys.platform == "linux" and self.memory_mib < inf:
            most = int(self.memory_mib * MIB)
            with contextlib.suppress(OSError):  # it has ended, or may not be confined
                _, hard = resource.prlimit(pid, resource.RLIMIT_DATA)
                # RLIM_INFINITY is -1, so the smaller number would be wrong.
                most = most if hard == resource.RLIM_INFINITY else min(most, hard)
                resource.prlimit(pid, resource.RLIMIT_DATA, (most, most))


NO_BOUNDS = SettingBounds(inf)


def half_of_the_memory_mib(containers_limit: Path = CONTAINERS_LIMIT) -> float:
    """Return half of the memory of the machine or container, so that the rest stays free. [MiB]

    Never less than `LEAST_MIB`.
    """
    return max(memory_mib(containers_limit) // 2, LEAST_MIB)


def memory_mib(containers_limit: Path = CONTAINERS_LIMIT) -> float:
    """Return the memory of the machine, or of the container. [MiB]"""
    most = psutil.virtual_memory().total
    with contextlib.suppress(OSError, ValueError):  # there is no such file, or it says "max"
        most = min(most, int(containers_limit.read_text()))
    return float(most // MIB)


def count_fitting_learners(memory_mib: float) -> int:
    """Return the number of learners that fit into a memory before their first step; at least 1."""
    return max(1, int(memory_mib // LEARNER_MIB))


def choose_campaigns() -> int:
    """Return how many campaigns run at a time if no option sets the number."""
    return min(SOME_CAMPAIGNS, count_fitting_learners(memory_mib()))
