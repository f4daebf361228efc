"""Processor time that an inner process takes, held against what its episodes may take."""

import contextlib
import time
from collections.abc import Callable, Iterable

import psutil

from eigenfail_workers.worker.limits import CPU_OPTION, CPU_VARIABLE, Limits


class ProcessorTime:
    """Counts it from the begin of one episode to that of the next.

    What an episode took beyond as many processors as it may keep busy counts against the next one,
    too: threads that it left behind go on. So does what is taken while none runs.

    Args:
        limits: of the inner process.
        clock: seconds that only ever grow.
    """

    def __init__(self, limits: Limits, clock: Callable[[], float] = time.monotonic) -> None:
        self._limits = limits
        self._clock = clock
        self._episode: object = None
        self._since_s = clock()
        self._before_s = 0.0

    def excess(self, taken_s: float, episode: object, beside: int = 1) -> str:
        """What was taken too much, as the predicate of a sentence; empty if it was not.

        Args:
            taken_s: by all of its processes in their lives so far. [s]
            episode: that runs, by a name; None while none does.
            beside: how many run side by side, which may take as often as much.
        """
        if episode != self._episode:
            self._settle(taken_s)
            self._episode = episode
        counted_s, limit_s = taken_s - self._before_s, self._limits.cpu_s * beside
        if counted_s <= limit_s:
            return ""
        return (
            f"took {counted_s:.0f} s of processor time, where {limit_s:g} s is the limit "
            f"({CPU_OPTION} of the worker, or {CPU_VARIABLE})"
        )

    def _settle(self, taken_s: float) -> None:
        now_s = self._clock()
        if self._episode is not None:
            granted_s = self._limits.processors * (now_s - self._since_s)
            self._before_s = min(taken_s, self._before_s + granted_s)
        self._since_s = now_s


def processor_time_s(processes: Iterable[psutil.Process]) -> float:
    """What they have taken, with all that they have waited for. [s]"""
    return sum(map(taken_by, processes))


def taken_by(process: psutil.Process) -> float:
    """What one has taken; nothing if it is gone: then it is its parent's. [s]"""
    with contextlib.suppress(psutil.Error):
        times = process.cpu_times()
        return float(times.user + times.system + times.children_user + times.children_system)
    return 0.0
