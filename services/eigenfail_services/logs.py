"""Where processes of the service log to: standard error, as far as there is room for it."""

import sys
from contextlib import suppress
from typing import TextIO

import structlog


class Lossy:
    """A stream that drops what it cannot write: a full disk must not end who complains of it."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """As many characters as are written, or lost."""
        with suppress(OSError):
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Whatever can be."""
        with suppress(OSError):
            self._stream.flush()


def configure() -> None:
    """Log to standard error, and never fail at it."""
    stream: TextIO = Lossy(sys.stderr)  # type: ignore[assignment]
    structlog.configure(logger_factory=structlog.PrintLoggerFactory(stream))
