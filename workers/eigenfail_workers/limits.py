"""Limits on what an episode and the child process of a worker may use, and how users set them."""

import contextlib
import math
import os
import resource
import sys
from pathlib import Path

import msgspec

from eigenfail.bridges import EPISODE_OPTION, EPISODE_VARIABLE
from eigenfail.errors import InvalidValue

EPISODE_S = 60.0
MEMORY_MIB = 4096.0
OUTPUT_KIB = 64.0
PROCESSORS = 4.0

RENEWAL = os.EX_TEMPFAIL
"""Exit status of a child process that asks for a fresh process to run the remaining episodes."""


DEFAULT_FILES = 4096


SPARE_FILES = 64


MAX_OOM_SCORE = "1000"
"""If the machine runs out of memory, the kernel kills the child process first."""


class LimitOption(msgspec.Struct, frozen=True):
    """A limit that users can set: its option, variable and unit, its least value, and a reserve."""

    option: str
    variable: str
    unit: str
    least: float
    reserve: str

    def read(self, given: str | None, default: float) -> float:
        """Return the limit: of the option, else of the environment, else the default.

        Args:
            given: value of the option, if it was given.
            default: value without option and environment.

        Raises:
            InvalidValue: the value is not a number, or is less than the least value.
        """
        written = given or os.environ.get(self.variable)
        if not written:
            return default
        try:
            limit = float(written)
        except ValueError:
            limit = math.nan
        if not self.least <= limit < math.inf:
            raise InvalidValue(
                self.option,
                f"'{written}' is no number of {self.unit}, {self.least:g} or more.",
                f"Give the option or {self.variable} what a planner needs, {self.reserve} "
                "to spare.",
            )
        return limit


EPISODE = LimitOption(EPISODE_OPTION, EPISODE_VARIABLE, "seconds", 1.0, "and 10 s")
# Simulator, planner and numpy take 150 MiB, and a few seconds, before the first episode begins.
MEMORY = LimitOption("--memory-limit", "EIGENFAIL_MEMORY_LIMIT_MIB", "MiB", 256.0, "and 200 MiB")
CPU = LimitOption("--cpu-limit", "EIGENFAIL_CPU_LIMIT_S", "seconds", 10.0, "and 5 s")
OUTPUT = LimitOption("--output-limit", "EIGENFAIL_OUTPUT_LIMIT_KIB", "KiB", 1.0, "and 1 KiB")


class Limits(msgspec.Struct, frozen=True):
    """Limits of one child process together with all its descendants.

    Attributes:
        memory_mib: memory that only the end of processes can free, so without cached files.
        files: open files of each process.
        threads: threads of all processes; each process counts at least once.
        cpu_s: processor time for an episode.
        processors: processors that may be kept busy from one episode to the next.
        episode_s: wall time of an episode, for the processes that run it.
        output_kib: output of an episode that is copied to standard error; the rest is dropped.
    """

    memory_mib: float = MEMORY_MIB
    files: int = DEFAULT_FILES
    threads: int = 1024
    cpu_s: float = PROCESSORS * EPISODE_S
    processors: float = PROCESSORS
    episode_s: float = EPISODE_S
    output_kib: float = OUTPUT_KIB


def read_episode_limit(given: str | None = None) -> float:
    """Return the wall time that an episode may take, from the option or the environment. [s]

    Raises:
        InvalidValue: the value is not a number of seconds, or is less than one.
    """
    return EPISODE.read(given, EPISODE_S)


def read_limits(
    memory_limit: str | None = None,
    cpu_limit: str | None = None,
    episode_limit: str | None = None,
    output_limit: str | None = None,
) -> Limits:
    """Return the limits of a child process, from options and environment.

    Args:
        memory_limit: option for memory [MiB], if it was given.
        cpu_limit: option for processor time [s], if it was given.
        episode_limit: option for the wall time of an episode [s], if it was given; the default of
            processor time is a multiple of it.
        output_limit: option for output [KiB], if it was given.

    Raises:
        InvalidValue: a value is not a number, or is less than a child process needs by itself.
    """
    episode_s = read_episode_limit(episode_limit)
    cpu_s = CPU.read(cpu_limit, PROCESSORS * episode_s)
    return Limits(
        memory_mib=MEMORY.read(memory_limit, MEMORY_MIB),
        cpu_s=cpu_s,
        processors=max(1.0, cpu_s / episode_s),
        episode_s=episode_s,
        output_kib=OUTPUT.read(output_limit, OUTPUT_KIB),
    )


def apply_kernel_limits(files: int = DEFAULT_FILES) -> None:
    """Set the limits that the kernel enforces for this process and its descendants (Linux only).

    Args:
        files: open files of each process.
    """
    if sys.platform == "linux":
        # A process without privileges cannot raise its hard limit.
        files = min(files, resource.getrlimit(resource.RLIMIT_NOFILE)[1])
        resource.setrlimit(resource.RLIMIT_NOFILE, (files, files))
        # A planner that crashes again and again would fill the disk with dumps of its memory.
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        with contextlib.suppress(OSError):  # /proc may be read-only
            Path("/proc/self/oom_score_adj").write_text(MAX_OOM_SCORE)


def is_out_of_files() -> bool:
    """Return whether this process can hardly open another file.

    A new file gets the lowest free number: if it is close to the limit, few numbers are left.
    """
    try:
        lowest = os.dup(0)
    except OSError:
        return True
    os.close(lowest)
    return lowest + SPARE_FILES > resource.getrlimit(resource.RLIMIT_NOFILE)[0]
