"""Parts that all programs share: no secrets in errors, and output that can fail."""

import argparse
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, NoReturn, TextIO

from eigenfail.errors import EigenfailError

BROKEN_PIPE = 128 + signal.SIGPIPE
"""The exit code that a shell shows for a program that the signal ended."""


class Parser(argparse.ArgumentParser):
    """A parser that repeats no key and no password in its errors."""

    def error(self, message: str) -> NoReturn:
        """Print the error of the command line, and exit with 2."""
        from eigenfail.values.access import redact

        super().error(redact(message))


class CheckedOutput:
    """A text stream whose failed writes end the program with one sentence, or silently.

    If the reader has closed its end of a pipe, the program ends silently with 141 (SIGPIPE). Any
    other failed write, for example to a full disk, raises EigenfailError.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._failure: EigenfailError | SystemExit | None = None

    def write(self, text: str) -> int:
        """Write text; return the number of characters."""
        if text == "":  # libraries try out by it what a stream takes
            return 0
        with self._checked():
            return self._stream.write(text)

    def writelines(self, lines: Iterable[str]) -> None:
        """Write lines without changing them."""
        with self._checked():
            self._stream.writelines(lines)

    def flush(self) -> None:
        """Write the buffer."""
        with self._checked():
            self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        """Return any other attribute from the stream."""
        return getattr(self._stream, name)

    @contextmanager
    def _checked(self) -> Iterator[None]:
        # Libraries may catch the first error and write on: it is raised until the program ends.
        if self._failure is not None:
            raise self._failure
        try:
            yield
        except BrokenPipeError:
            self._failure = SystemExit(BROKEN_PIPE)
        except OSError as error:
            self._failure = EigenfailError(
                f"Standard output cannot be written: {error.strerror or error}.",
                "Free disk space, or redirect the output.",
            )
        if self._failure is not None:
            self._discard()
            raise self._failure

    def _discard(self) -> None:
        """Discard unwritten text, at which the interpreter would fail again at exit."""
        with suppress(OSError, ValueError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._stream.fileno())
            os.close(nowhere)


@contextmanager
def checked_stdout() -> Iterator[None]:
    """Check that everything written to standard output in the block arrives completely.

    Raises:
        EigenfailError: it could not be written.
        SystemExit: the reader of the output has closed it.
    """
    stream = sys.stdout
    if stream is None:  # it was closed before the program began
        yield
        return
    checked = CheckedOutput(stream)
    # rich and typer take `sys.stdout` anew at each print, so that they write to this one.
    sys.stdout = checked
    try:
        yield
    except SystemExit as end:
        if not end.code:
            checked.flush()
        raise
    else:
        checked.flush()
    finally:
        sys.stdout = stream


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
    # A debugger or a test runner that set a hook wants to see the error itself.
    if sys.excepthook is sys.__excepthook__:
        sys.excepthook = lambda _kind, error, _trace: _report_error(report, error)
    if threading.excepthook is threading.__excepthook__:
        threading.excepthook = lambda found: _report_error(report, found.exc_value)
    if sys.unraisablehook is sys.__unraisablehook__:
        sys.unraisablehook = lambda found: _report_error(report, found.exc_value)


def _report_error(report: Report, error: BaseException | None) -> None:
    """Ignore SystemExit, which is not an error."""
    if error is not None and not isinstance(error, SystemExit):
        report(error)
