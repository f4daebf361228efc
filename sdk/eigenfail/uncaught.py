"""Uncaught errors: printed without secrets, and without the values of variables."""

import sys
import threading
import traceback
from collections.abc import Callable
from contextlib import suppress

Report = Callable[[BaseException], None]


def print_uncaught(error: BaseException) -> None:
    """Print an error as Python does, without the secrets in it."""
    from eigenfail.values.access import redact  # all of the values, for which no command waits

    with suppress(OSError, ValueError):
        sys.stderr.write(redact("".join(traceback.format_exception(error))))


def report_uncaught(report: Report = print_uncaught) -> None:
    """Print uncaught errors of all threads without secrets; hooks set before are kept.

    Args:
        report: reports an error.
    """
    if sys.excepthook is sys.__excepthook__:
        sys.excepthook = lambda _kind, error, _trace: _report_error(report, error)
    if threading.excepthook is threading.__excepthook__:
        threading.excepthook = lambda found: _report_error(report, found.exc_value)
    if sys.unraisablehook is sys.__unraisablehook__:
        sys.unraisablehook = lambda found: _report_error(report, found.exc_value)


def _report_error(report: Report, error: BaseException | None) -> None:
    """Ignore SystemExit, which is no error."""
    if error is not None and not isinstance(error, SystemExit):
        report(error)
