"""What the inner process of a worker, and all that it starts, may take of the machine."""

import contextlib
import os
import resource
import sys
from pathlib import Path

import msgspec

from eigenfail_workers.episode_limit import EPISODE_S, Meant, read_number

MEMORY_VARIABLE = "EIGENFAIL_MEMORY_LIMIT_MIB"
MEMORY_OPTION = "--memory-limit"
MEMORY_MIB = 4096.0
CPU_VARIABLE = "EIGENFAIL_CPU_LIMIT_S"
CPU_OPTION = "--cpu-limit"
PROCESSORS = 4.0

DEFAULT_FILES = 4096
SPARE_FILES = 64
FIRST_TO_GO = "1000"
"""Should the machine itself run out of memory, the kernel takes the inner process first."""


# Simulator, planner and numpy take 150 MiB, and a few seconds, before the first episode begins.
MEMORY = Meant(MEMORY_OPTION, MEMORY_VARIABLE, "MiB", 256.0, "and 200 MiB")
CPU = Meant(CPU_OPTION, CPU_VARIABLE, "seconds", 10.0, "and 5 s")


class Limits(msgspec.Struct, frozen=True):
    """Of one inner process with all the processes that it starts.

    Attributes:
        memory_mib: of all together; without what the kernel can drop, as the pages of files.
        files: open at a time, of each process.
        threads: of all together; a process counts as one at least.
        cpu_s: processor time of all together, for an episode.
        processors: how many all together may keep busy from one episode to the next.
        episode_s: wall time of an episode, as those learn it that run it.
    """

    memory_mib: float = MEMORY_MIB
    files: int = DEFAULT_FILES
    threads: int = 1024
    cpu_s: float = PROCESSORS * EPISODE_S
    processors: float = PROCESSORS
    episode_s: float = EPISODE_S


def confine(files: int = DEFAULT_FILES) -> None:
    """Have the kernel keep these of this process, and of what it will start (Linux).

    Args:
        files: open at a time, of each.
    """
    if sys.platform == "linux":
        files = min(files, resource.getrlimit(resource.RLIMIT_NOFILE)[1])
        resource.setrlimit(resource.RLIMIT_NOFILE, (files, files))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        with contextlib.suppress(OSError):  # /proc cannot be written
            Path("/proc/self/oom_score_adj").write_text(FIRST_TO_GO)


def files_used_up() -> bool:
    """Whether this process can open hardly another file: the next one gets the lowest number."""
    try:
        lowest = os.dup(0)
    except OSError:
        return True
    os.close(lowest)
    return lowest + SPARE_FILES > resource.getrlimit(resource.RLIMIT_NOFILE)[0]


def read_limits(
    memory_limit: str | None = None,
    cpu_limit: str | None = None,
    episode_limit_s: float = EPISODE_S,
) -> Limits:
    """The limits of memory [MiB] and processor time [s] as options or the environment have them.

    Args:
        memory_limit: as the option has it, if it was given.
        cpu_limit: likewise.
        episode_limit_s: wall time of an episode, by which processor time is measured.

    Raises:
        InvalidValue: one is no number, or less than an inner process takes by itself.
    """
    memory, cpu = (
        given or os.environ.get(variable)
        for given, variable in ((memory_limit, MEMORY_VARIABLE), (cpu_limit, CPU_VARIABLE))
    )
    cpu_s = read_number(cpu, CPU) if cpu else PROCESSORS * episode_limit_s
    return Limits(
        memory_mib=read_number(memory, MEMORY) if memory else MEMORY_MIB,
        cpu_s=cpu_s,
        processors=max(1.0, cpu_s / episode_limit_s),
        episode_s=episode_limit_s,
    )
