"""Processes that start processes, and leave none behind."""

import os
import signal
import sys
import time
from contextlib import suppress
from ctypes import CDLL
from subprocess import Popen, TimeoutExpired
from typing import NoReturn

PR_SET_PDEATHSIG = 1
PR_SET_CHILD_SUBREAPER = 36

PARENT_VARIABLE = "EIGENFAIL_PARENT"

END_S = 2.0
"""A killed process with much memory takes a while to give it back; nobody waits for longer."""

LOOK_EVERY_S = 0.005

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Environment of a process that shares its machine with others of its kind."""


def as_parent() -> dict[str, str]:
    """What the environment of a process says that is to die with this one."""
    return {PARENT_VARIABLE: str(os.getpid())}


def die_with_parent(by: signal.Signals = signal.SIGKILL) -> None:
    """Ask the kernel for a signal when this process's parent dies, even while it is busy (Linux).

    Unless it is another one, it kills.
    """
    if sys.platform == "linux":
        CDLL(None).prctl(PR_SET_PDEATHSIG, by)
    parent = os.environ.pop(PARENT_VARIABLE, None)
    if parent is not None and os.getppid() != int(parent):  # it died before the kernel was asked
        os._exit(128 + signal.SIGKILL)


def adopt_orphans() -> None:
    """Become the parent of whoever loses its own below this process (Linux).

    However it left its group or session: so it can still be found, and ended.
    """
    if sys.platform == "linux":
        CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1)


def exit_status(process: Popen[bytes]) -> int | None:
    """None while it lives; negative if a signal ended it.

    It is not waited for: until then its number is nobody else's, and `kill_group` finds by it what
    it left behind.
    """
    if process.returncode is None:
        with suppress(ChildProcessError):  # somebody else has waited for it
            told = os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
            if told is None:
                return None
            return told.si_status if told.si_code == os.CLD_EXITED else -told.si_status
    return process.poll()


def status_within(process: Popen[bytes], patience_s: float) -> int | None:
    """Its `exit_status` as soon as it has ended; None if it still lives when that is over."""
    until_s = time.monotonic() + patience_s
    while (status := exit_status(process)) is None and time.monotonic() < until_s:
        time.sleep(LOOK_EVERY_S)
    return status


def kill_group(leader: Popen[bytes]) -> None:
    """Kill a process that leads a group, and its group with it.

    Unless it was waited for: then the number of the group may be somebody else's by now.
    """
    if leader.returncode is None:
        with suppress(ProcessLookupError):
            os.killpg(leader.pid, signal.SIGKILL)
        with suppress(TimeoutExpired):
            leader.wait(END_S)


def end_now(status: int) -> NoReturn:
    """End this process without waiting for its threads, with all that was printed."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)
