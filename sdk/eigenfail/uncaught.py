"""Uncaught errors: printed without secrets, and without the values of variables."""

import sys
import threading
import traceback
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType

Tell = Callable[[BaseException], None]


def print_uncaught(error: BaseException) -> None:
    """As Python itself would, but for the secrets in it."""
    from eigenfail.values.access import redact  # all of the values, for which no command waits

    with suppress(OSError, ValueError):
        sys.stderr.write(redact("".join(traceback.format_exception(error))))


def tell_uncaught(tell: Tell = print_uncaught) -> None:
    """Print uncaught errors of all threads without secrets; hooks set before are kept.

    Args:
        tell: tells of an error.
    """
    if sys.excepthook is sys.__excepthook__:
        sys.excepthook = _of_main(tell)
    if threading.excepthook is threading.__excepthook__:
        threading.excepthook = lambda found: _told(tell, found.exc_value)
    if sys.unraisablehook is sys.__unraisablehook__:
        sys.unraisablehook = lambda found: _told(tell, found.exc_value)


def _of_main(
    tell: Tell,
) -> Callable[[type[BaseException], BaseException, TracebackType | None], None]:
    return lambda _kind, error, _trace: _told(tell, error)


def _told(tell: Tell, error: BaseException | None) -> None:
    """Ignore SystemExit, which is no error."""
    if error is not None and not isinstance(error, SystemExit):
        tell(error)
