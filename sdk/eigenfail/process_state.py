"""Process-wide state on which numbers depend, and which every plug-in can change.

The floating-point mode and numpy's error state belong to a thread, the rest to the whole process.
An episode must leave all of it unchanged: otherwise the results of the next episodes depend on it.
"""

import builtins
import contextlib
import ctypes
import locale
import math
import os
import signal
import sys
from collections.abc import Callable, Iterator
from operator import is_
from types import ModuleType

import numpy as np

from eigenfail.errors import describe_error

PATCHABLE: tuple[ModuleType, ...] = (builtins, math, np, np.linalg, np.random)
"""Modules whose functions the measures and the noise sources use."""

SIGNALS = sorted(map(int, signal.valid_signals() - {signal.SIGKILL, signal.SIGSTOP}))[:29]
"""The signals with a name; real-time signals have no handler that anything here relies on."""

# These stand in variables, as Python computes expressions of constants when it compiles them.
_ONE, _TINY = 1.0, 2.0**-60
_SMALLEST_NORMAL, _HALF = sys.float_info.min, 0.5
_DENORMAL, _LARGE = 5e-324, 2.0**1000

FE_DFL_ENV = ctypes.c_void_p(-1)
"""glibc's address of the floating-point environment in which a process starts."""


def _libc_function(name: str) -> Callable[..., int] | None:
    """The C function of that name, if this platform has it (glibc and musl differ)."""
    if sys.platform != "linux":
        return None
    return getattr(ctypes.CDLL(None), name, None)


_fegetexcept = _libc_function("fegetexcept")
_fesetenv = _libc_function("fesetenv")


def rounding_mode() -> str:
    """Return the rounding mode of this thread, found by arithmetic.

    To nearest, a number far below the last bit of 1 changes nothing, whatever its sign.
    """
    if _ONE + _TINY != _ONE:
        return "upward"
    if _ONE - _TINY == _ONE:
        return "to nearest"
    return "toward zero" if -_ONE - _TINY == -_ONE else "downward"


def handles_denormals() -> str:
    """Return what this thread does with denormal numbers, found by arithmetic."""
    if _SMALLEST_NORMAL * _HALF == 0.0:
        return "flushed to zero"
    return "kept" if _DENORMAL * _LARGE else "read as zero"


def _floating_point() -> tuple[str, str, int]:
    return rounding_mode(), handles_denormals(), _fegetexcept() if _fegetexcept else 0


def _current_directory() -> str:
    try:
        return os.getcwd()  # noqa: PTH109 - a Path takes ten times as long
    except OSError:
        return "removed"


class ProcessState:
    """The process-wide state at one moment; it costs some tens of microseconds.

    Not included are random generators (no result uses those of the process), the environment, and
    warning filters, which imports add to at any time.
    """

    def __init__(self) -> None:
        self._floating_point = _floating_point()
        self._errors = np.geterr(), np.geterrcall()
        self._locale = locale.setlocale(locale.LC_ALL)
        self._directory = _current_directory()
        self._handlers = [*map(signal.getsignal, SIGNALS)]
        self._contents = [tuple(vars(module).values()) for module in PATCHABLE]
        self._names = [tuple(vars(module)) for module in PATCHABLE]

    def changes(self) -> list[str]:
        """Return the differences to the present state as phrases; empty if there are none."""
        try:
            return [] if self._is_unchanged() else list(self._find_changes())
        except Exception as error:  # noqa: BLE001 - a patched builtin may break what compares
            return [f"something that this comparison needs: {describe_error(error)}"]

    def _is_unchanged(self) -> bool:
        return (
            self._floating_point == _floating_point()
            and self._errors == (np.geterr(), np.geterrcall())
            and self._locale == locale.setlocale(locale.LC_ALL)
            and self._directory == _current_directory()
            and self._handlers == [*map(signal.getsignal, SIGNALS)]
            and self._has_same_contents()
        )

    def _has_same_contents(self) -> bool:
        """Compare in the order of definition: names that an import has added come at the end."""
        return all(
            all(map(is_, vars(module).values(), contents))
            for module, contents in zip(PATCHABLE, self._contents, strict=True)
        )

    def _find_changes(self) -> Iterator[str]:
        yield from self._find_floating_point_changes()
        compared = {
            "numpy's error state (np.seterr)": (self._errors, (np.geterr(), np.geterrcall())),
            "the locale": (self._locale, locale.setlocale(locale.LC_ALL)),
            "the current directory": (self._directory, _current_directory()),
        }
        for what, (before, now) in compared.items():
            if before != now:
                yield f"{what}, which was {before} and is {now}"
        for number, handler in zip(SIGNALS, self._handlers, strict=True):
            if handler != signal.getsignal(number):
                yield f"the handler of {signal.Signals(number).name}"
        for module, name, _ in self._patched():
            yield f"{module.__name__}.{name}"

    def _find_floating_point_changes(self) -> Iterator[str]:
        rounding, denormals, traps = self._floating_point
        rounding_now, denormals_now, traps_now = _floating_point()
        if rounding != rounding_now:
            yield f"the floating-point rounding mode, which was {rounding} and is {rounding_now}"
        if denormals != denormals_now:
            yield (
                "flush-to-zero of the processor: denormal numbers were "
                f"{denormals} and are {denormals_now}"
            )
        if traps != traps_now:
            yield "the floating-point traps of the processor"

    def _patched(self) -> Iterator[tuple[ModuleType, str, object]]:
        """Yield each attribute that was replaced or removed, with its earlier value."""
        missing = object()
        for module, names, contents in zip(PATCHABLE, self._names, self._contents, strict=True):
            for name, before in zip(names, contents, strict=True):
                if vars(module).get(name, missing) is not before:
                    yield module, name, before

    def restore(self) -> None:
        """Put back what can be put back; signal handlers only in the main thread."""
        if self._floating_point != _floating_point() and _fesetenv is not None:
            _fesetenv(FE_DFL_ENV)
        errors, callback = self._errors
        np.seterr(**errors)
        np.seterrcall(callback)
        with contextlib.suppress(locale.Error):
            locale.setlocale(locale.LC_ALL, self._locale)
        if self._directory != _current_directory():
            with contextlib.suppress(OSError):
                os.chdir(self._directory)
        for number, handler in zip(SIGNALS, self._handlers, strict=True):
            if handler != signal.getsignal(number):
                with contextlib.suppress(ValueError, TypeError):
                    signal.signal(number, handler)
        for module, name, before in list(self._patched()):
            setattr(module, name, before)
