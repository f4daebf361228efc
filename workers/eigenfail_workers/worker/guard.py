"""What an inner process started does not outlive it."""

import os
import select
import signal
import sys
from typing import NoReturn


def leave_guard() -> None:
    """Leave a process behind that kills this one's group when this one has ended (Linux).

    However it ends: by itself, by its parent, or because that was killed. To be called by the
    leader of a group, before it has threads. Without a handle on itself, which some builds of
    Python and some kernels do not give, it goes on and says so.
    """
    if sys.platform == "linux":
        try:
            leader = os.pidfd_open(os.getpid())
        except (AttributeError, OSError) as error:
            sys.stderr.write(f"What a planner starts may outlive this process: {error}.\n")
            return
        between = os.fork()
        if between == 0:
            _become_guard(os.getppid(), leader)
        os.close(leader)
        os.waitpid(between, 0)


def _become_guard(group: int, leader: int) -> NoReturn:
    """Nobody's child, so that a planner which waits for its own does not wait for this one."""
    try:
        if os.fork() == 0:
            os.setsid()
            os.closerange(0, leader)
            os.closerange(leader + 1, os.sysconf("SC_OPEN_MAX"))
            select.select([leader], [], [])
            os.killpg(group, signal.SIGKILL)
    finally:
        os._exit(0)
