"""Limits on what a child process and its descendants use: memory, threads, processor time, output.

No limit of the kernel fits memory. RLIMIT_AS counts reserved memory: in a process with torch,
sixteen idle threads reserve 1.1 GiB and use none of it. Neither RLIMIT_AS nor RLIMIT_DATA counts
the processes that a planner starts, and RLIMIT_NPROC counts all processes of the user. Therefore
the parent measures, and kills.
"""

import contextlib
import os
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from threading import Lock, Thread
from typing import IO

import psutil
import structlog

from eigenfail_workers.limits import CPU, MEMORY, OUTPUT, Limits

CHECK_EVERY_S = 0.2
MIB = 1024 * 1024
KIB = 1024
STANDARD_ERROR = 2
CHUNK_BYTES = 1 << 16
CHILDREN_FILE = Path("/proc/self/task") / str(os.getpid()) / "children"
"""Exists only where the kernel was built with CONFIG_PROC_CHILDREN."""
UNRECLAIMABLE = ("Pss_Anon:", "Pss_Shmem:", "SwapPss:")
UNREADABLE = (psutil.Error, OSError)
"""The process has ended, or this process has no file descriptor left to read its figures with."""

log = structlog.get_logger()


class ResourceMonitor:
    """Compares a process and its descendants with their limits, five times a second at most.

    Args:
        pid: pid of the child process.
        limits: for the child and its descendants together.
    """

    def __init__(self, pid: int, limits: Limits) -> None:
        self._pid = pid
        self._limits = limits
        self._next_check_s = 0.0
        self._processor_time = ProcessorTimeMeter(limits)

    def find_excess(self, episode: object = None, beside: int = 1) -> str:
        """Return the limit that is exceeded, as the predicate of a sentence, or "".

        Args:
            episode: identity of the episode that runs; None if none runs.
            beside: number of episodes that run side by side.
        """
        now_s = time.monotonic()
        if now_s < self._next_check_s:
            return ""
        self._next_check_s = now_s + CHECK_EVERY_S
        members = list_process_tree(self._pid)
        return (
            self._find_excess_threads(members)
            or self._find_excess_memory(members)
            or self._processor_time.find_excess(processor_time_s(members), episode, beside)
        )

    def _find_excess_memory(self, members: list[psutil.Process]) -> str:
        limit_mib = self._limits.memory_mib
        # Resident memory counts a shared page for each process: where even that is within the
        # limit, no closer look is needed.
        if sum(map(resident_mib, members)) <= limit_mib:
            return ""
        # The proportional share takes longer to read, but counts no shared page twice.
        used_mib = sum(map(_proportional_mib, members))
        if used_mib <= limit_mib:
            return ""
        return (
            f"took {used_mib:.0f} MiB of memory, where {limit_mib:g} MiB is the limit "
            f"({MEMORY.option} of the worker, or {MEMORY.variable})"
        )

    def _find_excess_threads(self, members: list[psutil.Process]) -> str:
        used, limit = sum(map(_count_threads, members)), self._limits.threads
        if used <= limit:
            return ""
        return f"ran {used} threads and processes, where {limit} is the limit"


class ProcessorTimeMeter:
    """Counts processor time from the start of one episode to the start of the next.

    Time beyond the processors that an episode may keep busy also counts against the next episode,
    because leftover threads go on. The same holds for time between episodes.

    Args:
        limits: limits of the child process.
        clock: monotonic clock. [s]
    """

    def __init__(self, limits: Limits, clock: Callable[[], float] = time.monotonic) -> None:
        self._limits = limits
        self._clock = clock
        self._episode: object = None
        self._since_s = clock()
        self._before_s = 0.0

    def find_excess(self, used_s: float, episode: object, beside: int = 1) -> str:
        """Return the excess of processor time, as the predicate of a sentence, or "".

        Args:
            used_s: processor time of all processes since their start. [s]
            episode: identity of the episode that runs; None if none runs.
            beside: number of episodes that run side by side; the limit is multiplied by it.
        """
        if episode != self._episode:
            self._begin(used_s)
            self._episode = episode
        counted_s, limit_s = used_s - self._before_s, self._limits.cpu_s * beside
        if counted_s <= limit_s:
            return ""
        return (
            f"took {counted_s:.0f} s of processor time, where {limit_s:g} s is the limit "
            f"({CPU.option} of the worker, or {CPU.variable})"
        )

    def _begin(self, used_s: float) -> None:
        now_s = self._clock()
        if self._episode is not None:
            # Granted by the wall time that has passed, and not beyond what was used: saved time is
            # not kept.
            granted_s = self._limits.processors * (now_s - self._since_s)
            self._before_s = min(used_s, self._before_s + granted_s)
        self._since_s = now_s


def list_process_tree(pid: int) -> list[psutil.Process]:
    """Return a process and its descendants."""
    found: list[psutil.Process] = []
    pids = [pid]
    # The list grows while it is read: each process adds its children behind.
    for each in pids:
        with contextlib.suppress(*UNREADABLE):
            found.append(psutil.Process(each))
            for children in Path(f"/proc/{each}/task").glob("*/children"):
                pids.extend(map(int, children.read_text().split()))
    if not CHILDREN_FILE.exists():  # psutil searches all processes of the machine, which is slower
        with contextlib.suppress(*UNREADABLE, IndexError):
            found += found[0].children(recursive=True)
    return found


def resident_mib(process: psutil.Process) -> float:
    """Resident memory of a process, shared pages included; 0 if it has ended. [MiB]"""
    with contextlib.suppress(*UNREADABLE):
        return float(process.memory_info().rss) / MIB
    return 0.0


def _proportional_mib(process: psutil.Process) -> float:
    """Share of a process in the memory that only the end of processes can free. [MiB]"""
    with contextlib.suppress(OSError):
        rollup = Path(f"/proc/{process.pid}/smaps_rollup").read_text().splitlines()
        fields = (line.split() for line in rollup)
        return sum(float(words[1]) / 1024 for words in fields if words[0] in UNRECLAIMABLE)
    return 0.0


def _count_threads(process: psutil.Process) -> int:
    with contextlib.suppress(*UNREADABLE):
        return int(process.num_threads())
    return 0


def processor_time_s(processes: Iterable[psutil.Process]) -> float:
    """Processor time of processes and of the ended children that they have waited for. [s]

    A process that has ended counts 0: its parent's time includes its time.
    """
    total_s = 0.0
    for process in processes:
        with contextlib.suppress(*UNREADABLE):
            times = process.cpu_times()
            total_s += times.user + times.system + times.children_user + times.children_system
    return total_s


class OutputLimiter:
    """Thread that copies a pipe to standard error, up to a limit for each episode.

    A planner may print gigabytes in a few episodes, and the worker's standard error is often a
    file without a bound. Beyond the limit, the thread reads on and drops the output: a planner
    that prints must not wait for a full pipe. The start of an episode is read from another pipe,
    so that its first output may count for the previous episode.

    Args:
        pipe: end to read from; the thread closes it.
        limit_kib: output that is copied between two calls of `start_episode`. [KiB]
    """

    def __init__(self, pipe: IO[bytes], limit_kib: float) -> None:
        self._pipe = pipe
        self._limit_kib = limit_kib
        self._lock = Lock()
        self._thread = Thread(target=self._run, name="output", daemon=True)
        self.start_episode()

    def start(self) -> None:
        """Start the thread.

        Raises:
            RuntimeError: the operating system cannot start a thread.
        """
        self._thread.start()

    def start_episode(self) -> None:
        """Allow the full limit again."""
        with self._lock:
            self._left = int(self._limit_kib * KIB)
            self._is_announced = False

    def join(self, timeout_s: float) -> None:
        """Wait until all output is copied, or until the time [s] is over."""
        self._thread.join(timeout_s)

    def _run(self) -> None:
        with self._pipe:
            while chunk := os.read(self._pipe.fileno(), CHUNK_BYTES):
                self._copy(chunk)

    def _copy(self, chunk: bytes) -> None:
        with self._lock:
            # Only the counters need the lock: a slow terminal must not hold up `start_episode`.
            copied = chunk[: self._left]
            self._left -= len(copied)
            announces = len(copied) < len(chunk) and not self._is_announced
            self._is_announced |= announces
        with contextlib.suppress(OSError):  # a full disk or a closed terminal ends no episode
            _write_unbuffered(copied)
            if announces:
                _write_unbuffered(b"\n")
                why = (
                    f"Simulator and planner printed more than {self._limit_kib:g} KiB in this "
                    f"episode, which is the limit ({OUTPUT.option} of the worker, or "
                    f"{OUTPUT.variable})."
                )
                log.warning("output suppressed", why=why)


def _write_unbuffered(data: bytes) -> None:
    while data:
        data = data[os.write(STANDARD_ERROR, data) :]
