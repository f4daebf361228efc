"""What an inner process started does not outlive it, whatever group or session it went into."""

import contextlib
import os
import resource
import signal
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from typing import NoReturn

from eigenfail.processes import adopt_orphans, as_parent, die_with_parent

ASKED_TO_END = signal.SIGTERM
HEARD = {ASKED_TO_END, signal.SIGCHLD}

END_S = 3.0
"""Who starts processes faster than they can be killed is not followed for longer."""

LOOK_EVERY_S = 0.05


def leave_guard() -> None:
    """Go on in a process of its own, which leads a session; this one stays behind as its guard.

    Whoever loses its parent below the guard is adopted by it. When the process has ended, or the
    guard's own parent has, or somebody sends the guard a SIGTERM, it kills all that is left, and
    ends as the process did. To be called before there are threads. Linux alone has what it takes.
    """
    if sys.platform != "linux":
        die_with_parent()
        return
    signal.pthread_sigmask(signal.SIG_BLOCK, HEARD)
    die_with_parent(ASKED_TO_END)
    adopt_orphans()
    os.environ.update(as_parent())
    guarded = os.fork()
    if guarded:
        _guard(guarded)
    os.setsid()
    signal.pthread_sigmask(signal.SIG_UNBLOCK, HEARD)
    die_with_parent()


def _guard(guarded: int) -> NoReturn:
    try:
        os.closerange(0, os.sysconf("SC_OPEN_MAX"))
        while signal.sigwait(HEARD) != ASKED_TO_END and not _has_ended(guarded):
            _bury(_others(guarded))
        _kill(guarded)
        _end_like(guarded)
    finally:
        os._exit(os.EX_OSERR)


def _has_ended(pid: int) -> bool:
    """Not waited for: until then its group is nobody else's."""
    return os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None


def _kill(guarded: int) -> None:
    """Kill it and its group at once, then who left that group."""
    for kill in (os.killpg, os.kill):  # it may not lead a group yet
        with contextlib.suppress(ProcessLookupError):
            kill(guarded, signal.SIGKILL)
    os.waitid(os.P_PID, guarded, os.WEXITED | os.WNOWAIT)  # by then its own are the guard's
    until_s = time.monotonic() + END_S
    while (left := _others(guarded)) and time.monotonic() < until_s:
        for pid in left:
            with contextlib.suppress(PermissionError):  # it became another user's
                os.kill(pid, signal.SIGKILL)
        signal.sigtimedwait(HEARD, LOOK_EVERY_S)
        _bury(left)


def _others(guarded: int) -> list[int]:
    """Whom this process has adopted, also those that only wait to be buried."""
    try:
        listed = Path(f"/proc/self/task/{os.getpid()}/children").read_text()
    except OSError:  # a kernel that was built without
        return []
    return [pid for pid in map(int, listed.split()) if pid != guarded]


def _bury(pids: Iterable[int]) -> None:
    for pid in pids:
        os.waitpid(pid, os.WNOHANG)


def _end_like(guarded: int) -> NoReturn:
    """End with the same exit status, or by the same signal, without a core file of its own."""
    code = os.waitstatus_to_exitcode(os.waitpid(guarded, 0)[1])
    if code < 0:
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        with contextlib.suppress(OSError):  # SIGKILL cannot be handled
            signal.signal(-code, signal.SIG_DFL)
        os.kill(os.getpid(), -code)
    os._exit(code)
