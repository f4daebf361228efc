"""How much an inner process takes, and whether that is more than it may.

No limit of the kernel's can say this of memory. RLIMIT_AS counts what is only reserved: sixteen
idle threads beside torch reserve 1.1 GiB and use none of it. Neither it nor RLIMIT_DATA counts the
processes that a planner starts; RLIMIT_NPROC counts everybody's.
"""

import contextlib
import os
import time
from pathlib import Path

import psutil

from eigenfail_workers.worker.limits import MEMORY_OPTION, MEMORY_VARIABLE, Limits
from eigenfail_workers.worker.processor_time import ProcessorTime, processor_time_s

LOOK_EVERY_S = 0.2
MIB = 1024 * 1024
LISTED = Path("/proc/self/task") / str(os.getpid()) / "children"
"""Only where the kernel was built with CONFIG_PROC_CHILDREN."""
KEPT_IN_MEMORY = ("Pss_Anon:", "Pss_Shmem:", "SwapPss:")


class Watch:
    """Looks at a process and its descendants from time to time.

    Args:
        pid: of the inner process.
        limits: what it may take.
    """

    def __init__(self, pid: int, limits: Limits) -> None:
        self._pid = pid
        self._limits = limits
        self._next_look_s = 0.0
        self._processor_time = ProcessorTime(limits)

    def excess(self, episode: object = None, beside: int = 1) -> str:
        """What it takes too much of, as the predicate of a sentence; empty if nothing is seen.

        Args:
            episode: that it runs, by a name, if it runs one.
            beside: how many it runs side by side.
        """
        now_s = time.monotonic()
        if now_s < self._next_look_s:
            return ""
        self._next_look_s = now_s + LOOK_EVERY_S
        members = family(self._pid)
        return (
            self._excess_of_threads(members)
            or self._excess_of_memory(members)
            or self._processor_time.excess(processor_time_s(members), episode, beside)
        )

    def _excess_of_memory(self, members: list[psutil.Process]) -> str:
        limit_mib = self._limits.memory_mib
        if sum(map(resident_mib, members)) <= limit_mib:
            return ""
        taken_mib = sum(map(kept_mib, members))  # dearer to find out, but nothing counts twice
        if taken_mib <= limit_mib:
            return ""
        return (
            f"took {taken_mib:.0f} MiB of memory, where {limit_mib:g} MiB is the limit "
            f"({MEMORY_OPTION} of the worker, or {MEMORY_VARIABLE})"
        )

    def _excess_of_threads(self, members: list[psutil.Process]) -> str:
        taken, limit = sum(map(threads, members)), self._limits.threads
        if taken <= limit:
            return ""
        return f"ran {taken} threads and processes, where {limit} is the limit"


def family(pid: int) -> list[psutil.Process]:
    """A process and its descendants."""
    found: list[psutil.Process] = []
    pids = [pid]
    for each in pids:
        with contextlib.suppress(psutil.Error, OSError):
            found.append(psutil.Process(each))
            for children in Path(f"/proc/{each}/task").glob("*/children"):
                pids.extend(map(int, children.read_text().split()))
    return found if LISTED.exists() else [*found, *below(found)]


def below(found: list[psutil.Process]) -> list[psutil.Process]:
    """Descendants as all processes of the machine tell them, which takes longer."""
    with contextlib.suppress(psutil.Error, IndexError):
        return list(found[0].children(recursive=True))
    return []


def resident_mib(process: psutil.Process) -> float:
    """What it has in memory, shared or not. [MiB]"""
    with contextlib.suppress(psutil.Error):
        return float(process.memory_info().rss) / MIB
    return 0.0


def kept_mib(process: psutil.Process) -> float:
    """Its share of the memory that can only be given back by ending processes. [MiB]"""
    with contextlib.suppress(OSError):
        rollup = Path(f"/proc/{process.pid}/smaps_rollup").read_text().splitlines()
        fields = (line.split() for line in rollup)
        return sum(float(words[1]) / 1024 for words in fields if words[0] in KEPT_IN_MEMORY)
    return 0.0


def threads(process: psutil.Process) -> int:
    """How many it runs."""
    with contextlib.suppress(psutil.Error):
        return int(process.num_threads())
    return 0
