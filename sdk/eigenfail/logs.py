"""What the processes of a service say of themselves: on standard error, as text or as JSON.

As JSON, each line is an object: `timestamp`, `level`, `event`, `process` (controller, services,
worker), and whatever it concerns by the same names everywhere: `campaign`, `episode`, `worker`.
structlog comes with services and workers; the bare client has none, and logs nothing.
"""

import logging
import os
import sys
from collections.abc import Callable, MutableMapping
from contextlib import suppress
from typing import Any, TextIO

from eigenfail.errors import InvalidValue
from eigenfail.values.access import redacted

VARIABLE = "EIGENFAIL_LOG_FORMAT"


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


def configure(process: str) -> None:
    """Log to standard error, and never fail at it.

    Args:
        process: which one of the service it is.

    Raises:
        InvalidValue: the environment asks for a format that there is not.
    """
    stream: TextIO = LossyStderr()  # type: ignore[assignment]
    wanted = os.environ.get(VARIABLE) or "text"
    if wanted not in FORMATS:
        raise InvalidValue(VARIABLE, f"'{wanted}' is no format of logs.", "Take text or json.")
    FORMATS[wanted](process, stream)


def _as_text(_process: str, stream: TextIO) -> None:
    import structlog

    structlog.configure(logger_factory=structlog.PrintLoggerFactory(stream))
    logging.basicConfig(stream=stream, format="%(levelname)s: %(message)s")


def _as_json(process: str, stream: TextIO) -> None:
    """Also what others log by the standard library, such as the HTTP server."""
    import structlog

    def named(_logger: Any, _method: str, event: dict[str, Any]) -> dict[str, Any]:
        return {"process": process} | event

    common: list[Any] = [
        structlog.contextvars.merge_contextvars,
        structlog.stdlib.add_log_level,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
        structlog.processors.format_exc_info,
        named,
    ]
    json = structlog.processors.JSONRenderer()

    def rendered(logger: Any, method: str, event: MutableMapping[str, Any]) -> str:
        return redacted(str(json(logger, method, event)))

    factory = structlog.PrintLoggerFactory(stream)
    structlog.configure(processors=[*common, rendered], logger_factory=factory)
    handler = logging.StreamHandler(stream)
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=common,
            processors=[structlog.stdlib.ProcessorFormatter.remove_processors_meta, rendered],
        )
    )
    logging.basicConfig(handlers=[handler])


FORMATS: dict[str, Callable[[str, TextIO], None]] = {"text": _as_text, "json": _as_json}
