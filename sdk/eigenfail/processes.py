"""Processes that start processes, and leave none behind."""

import os
import signal
import sys
from ctypes import CDLL
from typing import NoReturn

PR_SET_PDEATHSIG = 1

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Environment of a process that shares its machine with others of its kind."""


def die_with_parent() -> None:
    """Ask the kernel to kill this process when its parent dies, even while it is busy (Linux)."""
    if sys.platform == "linux":
        CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def end_now(status: int) -> NoReturn:
    """End this process without waiting for its threads, with all that was printed."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)
