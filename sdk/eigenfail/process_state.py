"""Process-wide state that numbers depend on and that every plug-in can change.

The floating-point mode and numpy's error state belong to a thread, the rest to the whole process.
An episode must leave the state unchanged: otherwise the results of later episodes depend on it.
"""

import contextlib
import ctypes
import os
import signal
import sys
from collections.abc import Callable

import numpy as np

SIGNALS = sorted(map(int, signal.valid_signals() - {signal.SIGKILL, signal.SIGSTOP}))[:29]
"""The signals with a name; real-time signals have no handler that anything here relies on."""

# These stand in variables, as Python computes expressions of constants when it compiles them.
_ONE, _TINY = 1.0, 2.0**-60
_SMALLEST_NORMAL, _HALF = sys.float_info.min, 0.5
_DENORMAL, _LARGE = 5e-324, 2.0**1000

FE_DFL_ENV = ctypes.c_void_p(-1)
"""glibc's address of the floating-point environment in which a process starts."""


def _libc_function(name: str) -> Callable[..., int] | None:
    """Return the C function of a name; None if this platform lacks it (glibc and musl differ)."""
    if sys.platform != "linux":
        return None
    return getattr(ctypes.CDLL(None), name, None)


_fesetenv = _libc_function("fesetenv")


def rounding_mode() -> str:
    """Return the rounding mode of this thread, found by arithmetic.

    With rounding to nearest, adding a number far below the last bit of 1, of either sign, leaves 1.
    """
    # By arithmetic, as `fegetround` does not see what SSE instructions have been told directly.
    if _ONE + _TINY != _ONE:
        return "upward"
    if _ONE - _TINY == _ONE:
        return "to nearest"
    return "toward zero" if -_ONE - _TINY == -_ONE else "downward"


def read_flush_to_zero() -> str:
    """Return whether this thread flushes denormal numbers to zero, found by arithmetic."""
    if _SMALLEST_NORMAL * _HALF == 0.0:
        return "on"
    return "off" if _DENORMAL * _LARGE else "on for operands"


def _current_directory() -> str:
    try:
        return os.getcwd()  # noqa: PTH109 - a Path takes ten times as long
    except OSError:
        return "removed"


class ProcessState:
    """The process-wide state at one moment; reading it takes some tens of microseconds.

    It excludes random generators (results do not use the generators of the process), the locale,
    the environment, warning filters, and functions that were replaced in other modules.
    """

    def __init__(self) -> None:
        self._rounding, self._flushing = rounding_mode(), read_flush_to_zero()
        self._errors = np.geterr()
        self._directory = _current_directory()
        self._handlers = [*map(signal.getsignal, SIGNALS)]

    def changes(self) -> list[str]:
        """Return the differences to the present state as phrases; empty if there are none."""
        compared = {
            "the floating-point rounding mode": (self._rounding, rounding_mode()),
            "flush-to-zero of the processor": (self._flushing, read_flush_to_zero()),
            "numpy's error state (np.seterr)": (self._errors, np.geterr()),
            "the current directory": (self._directory, _current_directory()),
        }
        found = [
            f"{what}, which was {before} and is {now}"
            for what, (before, now) in compared.items()
            if before != now
        ]
        handlers = zip(SIGNALS, self._handlers, strict=True)
        changed = [number for number, before in handlers if before != signal.getsignal(number)]
        return found + [f"the handler of {signal.Signals(number).name}" for number in changed]

    def restore(self) -> None:
        """Restore the state as far as possible; signal handlers only in the main thread."""
        modes = rounding_mode(), read_flush_to_zero()
        if modes != (self._rounding, self._flushing) and _fesetenv is not None:
            _fesetenv(FE_DFL_ENV)
        np.seterr(**self._errors)
        if self._directory != _current_directory():
            with contextlib.suppress(OSError):
                os.chdir(self._directory)
        for number, handler in zip(SIGNALS, self._handlers, strict=True):
            if handler != signal.getsignal(number):
                with contextlib.suppress(ValueError, TypeError):
                    signal.signal(number, handler)
