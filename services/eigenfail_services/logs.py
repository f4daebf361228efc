"""Where processes of the service log to: standard error, as far as there is room for it."""

import sys
from contextlib import suppress
from typing import TextIO

import structlog


class LossyStderr:
    """Standard error, as it is by then, without what cannot be written.

    A full disk must not end who complains of it, nor a stream that somebody has closed.
    """

    def write(self, text: str) -> int:
        """As many characters as are written, or lost."""
        with suppress(OSError, ValueError):
            sys.stderr.write(text)
        return len(text)

    def flush(self) -> None:
        """Whatever can be."""
        with suppress(OSError, ValueError):
            sys.stderr.flush()


def configure() -> None:
    """Log to standard error, and never fail at it."""
    stream: TextIO = LossyStderr()  # type: ignore[assignment]
    structlog.configure(logger_factory=structlog.PrintLoggerFactory(stream))
