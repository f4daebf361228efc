"""A guard process that kills all descendants of its child, in any group or session."""

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

END_SIGNAL = signal.SIGTERM
AWAITED = {END_SIGNAL, signal.SIGCHLD}

KILL_S = 3.0
"""Time limit for killing, in case that processes are started faster than they can be killed."""

CHECK_EVERY_S = 0.05


def fork_under_guard() -> None:
    """Continue in a new process that leads a session; the present process remains as its guard.

    The guard adopts descendants that lose their parent. It waits until the new process or the
    guard's own parent has ended, or until it receives SIGTERM. Then the guard kills all remaining
    processes, and ends with the exit status of the new process. Call this function before any
    thread is started. Only Linux has the necessary system calls; elsewhere the process only ends
    with its parent.
    """
    if sys.platform != "linux":
        die_with_parent()
        return
    # Blocked before the fork, so that a signal that comes at once waits for `sigwait`.
    signal.pthread_sigmask(signal.SIG_BLOCK, AWAITED)
    die_with_parent(END_SIGNAL)
    adopt_orphans()
    os.environ.update(as_parent())
    # A process of its own is needed: only a parent can adopt and kill what a crashed child leaves.
    guarded = os.fork()
    if guarded:
        _guard(guarded)
    os.setsid()
    signal.pthread_sigmask(signal.SIG_UNBLOCK, AWAITED)
    die_with_parent()


def _guard(guarded: int) -> NoReturn:
    try:
        # The guard outlives the child: an open end of a pipe here would hide the child's end from
        # the parent.
        os.closerange(0, os.sysconf("SC_OPEN_MAX"))
        while signal.sigwait(AWAITED) != END_SIGNAL:
            # Not reaped: until then the kernel gives the number of its group to no other process.
            if os.waitid(os.P_PID, guarded, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None:
                break
            _reap(_list_adopted_processes(guarded))
        _kill(guarded)
        _end_like(guarded)
    finally:
        # Reached only if an error escaped: the guard must never run on as a second child.
        os._exit(os.EX_OSERR)


def _kill(guarded: int) -> None:
    """Kill the process and its group at once, then the descendants that have left that group."""
    for kill in (os.killpg, os.kill):  # it may not lead a group yet
        with contextlib.suppress(ProcessLookupError):
            kill(guarded, signal.SIGKILL)
    # When it has ended, the guard has adopted its children.
    os.waitid(os.P_PID, guarded, os.WEXITED | os.WNOWAIT)
    until_s = time.monotonic() + KILL_S
    while (left := _list_adopted_processes(guarded)) and time.monotonic() < until_s:
        for pid in left:
            with contextlib.suppress(PermissionError):  # it runs as another user now
                os.kill(pid, signal.SIGKILL)
        signal.sigtimedwait(AWAITED, CHECK_EVERY_S)
        _reap(left)


def _list_adopted_processes(guarded: int) -> list[int]:
    """Return the adopted processes, also those that have ended and are not reaped."""
    try:
        listed = Path(f"/proc/self/task/{os.getpid()}/children").read_text()
    except OSError:  # the kernel was built without CONFIG_PROC_CHILDREN
        return []
    return [pid for pid in map(int, listed.split()) if pid != guarded]


def _reap(pids: Iterable[int]) -> None:
    for pid in pids:
        os.waitpid(pid, os.WNOHANG)


def _end_like(guarded: int) -> NoReturn:
    """End with the same exit status, or by the same signal, without another core file."""
    code = os.waitstatus_to_exitcode(os.waitpid(guarded, 0)[1])
    if code < 0:
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        with contextlib.suppress(OSError):  # SIGKILL cannot be handled
            signal.signal(-code, signal.SIG_DFL)
        os.kill(os.getpid(), -code)
    os._exit(code)
