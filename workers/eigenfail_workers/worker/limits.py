"""What the inner process of a worker, and all that it starts, may take of the machine."""

import contextlib
import math
import os
import resource
import sys
from pathlib import Path

import msgspec

from eigenfail.errors import InvalidValue

MEMORY_VARIABLE = "EIGENFAIL_MEMORY_LIMIT_MIB"
MEMORY_OPTION = "--memory-limit"
LEAST_MEMORY_MIB = 256.0
"""Simulator, planner and numpy take 150 MiB before the first episode begins."""

SPARE_FILES = 64
FIRST_TO_GO = "1000"
"""Should the machine itself run out of memory, the kernel takes the inner process first."""


class Limits(msgspec.Struct, frozen=True):
    """Of one inner process with all the processes that it starts.

    Attributes:
        memory_mib: of all together; without what the kernel can drop, as the pages of files.
        files: open at a time, of each process.
        threads: of all together; a process counts as one at least.
    """

    memory_mib: float = 4096.0
    files: int = 4096
    threads: int = 1024

    def confine(self, pid: int) -> None:
        """Have the kernel keep these of a process, and of what it will start (Linux)."""
        if sys.platform == "linux":
            with contextlib.suppress(OSError):  # it has ended, or /proc cannot be written
                files = min(self.files, resource.getrlimit(resource.RLIMIT_NOFILE)[1])
                resource.prlimit(pid, resource.RLIMIT_NOFILE, (files, files))
                resource.prlimit(pid, resource.RLIMIT_CORE, (0, 0))
                Path(f"/proc/{pid}/oom_score_adj").write_text(FIRST_TO_GO)


def files_used_up() -> bool:
    """Whether this process can open hardly another file: the next one gets the lowest number."""
    try:
        lowest = os.dup(0)
    except OSError:
        return True
    os.close(lowest)
    return lowest + SPARE_FILES > resource.getrlimit(resource.RLIMIT_NOFILE)[0]


def read_limits(memory_limit: str | None = None) -> Limits:
    """The limits with that of memory [MiB] as an option has it, or else the environment.

    Raises:
        InvalidValue: it is no number, or less than an inner process takes by itself.
    """
    written = memory_limit or os.environ.get(MEMORY_VARIABLE)
    return Limits(_memory_mib(written)) if written else Limits()


def _memory_mib(written: str) -> float:
    try:
        limit = float(written)
    except ValueError:
        limit = math.nan
    if not LEAST_MEMORY_MIB <= limit < math.inf:
        raise InvalidValue(
            MEMORY_OPTION,
            f"'{written}' is no number of MiB, {LEAST_MEMORY_MIB:g} or more.",
            f"Give the option or {MEMORY_VARIABLE} what a planner needs, and 200 MiB to spare.",
        )
    return limit
