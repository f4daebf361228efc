"""Logs of the processes of a service: on standard error, as text or as JSON.

As JSON, each line is an object with `timestamp`, `level`, `event` and `process` (controller,
services, worker). If they apply, it also has `campaign`, `episode` and `worker`, with the same
names in all logs. structlog comes with services and workers; the bare client does not log.

Keys and passwords are removed from all logs, and tracebacks do not show the values of variables.
"""

import logging
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Any, TextIO

from eigenfail.command_line import report_uncaught
from eigenfail.errors import InvalidValue
from eigenfail.values.access import redact

VARIABLE = "EIGENFAIL_LOG_FORMAT"

Format = tuple[list[Any], logging.Formatter]
"""What turns events of structlog into lines, and what formats the lines of other libraries."""


class LossyStderr:
    """Standard error without secrets; text that cannot be written is dropped.

    A full disk must not end the process that logs it, nor must a closed stream.
    """

    def write(self, text: str) -> int:
        """Write text; return the number of characters that are written or lost."""
        with suppress(OSError, ValueError):
            sys.stderr.write(redact(text))
        return len(text)

    def flush(self) -> None:
        """Flush standard error if possible."""
        with suppress(OSError, ValueError):
            sys.stderr.flush()


class Handler(logging.StreamHandler[TextIO]):
    """Handler for logs of other libraries through `logging`, such as the HTTP server's."""

    def handleError(self, _record: logging.LogRecord) -> None:  # noqa: N802 - the library's name
        """Drop a record that cannot be formatted: the library would print its arguments."""
        import structlog

        structlog.get_logger().error("a line of the log cannot be made", exc_info=True)


def configure(process: str) -> None:
    """Log to standard error, uncaught errors included; logging itself never raises.

    Args:
        process: name of the process: controller, services or worker.

    Raises:
        InvalidValue: the environment names an unknown format.
    """
    import structlog

    stream: TextIO = LossyStderr()  # type: ignore[assignment]
    wanted = os.environ.get(VARIABLE) or "text"
    # A typing error must not silently give a log that no collector can read.
    if wanted not in FORMATS:
        raise InvalidValue(VARIABLE, f"'{wanted}' is not a valid log format.", "Use text or json.")
    processors, formatter = FORMATS[wanted](process)
    structlog.configure(processors=processors, logger_factory=structlog.PrintLoggerFactory(stream))
    handler = Handler(stream)
    handler.setFormatter(formatter)
    logging.basicConfig(handlers=[handler])
    log = structlog.get_logger()
    report_uncaught(lambda error: log.error("uncaught error", exc_info=error))


def _as_text(_process: str) -> Format:
    import structlog

    lines = structlog.dev.ConsoleRenderer(
        colors=sys.stderr.isatty(),
        # The library's own choice prints the values of variables, and so keys and passwords.
        exception_formatter=structlog.dev.plain_traceback,
    )
    processors = [
        structlog.contextvars.merge_contextvars,
        structlog.processors.add_log_level,
        structlog.processors.StackInfoRenderer(),
        structlog.dev.set_exc_info,
        structlog.processors.TimeStamper(fmt="%Y-%m-%d %H:%M:%S", utc=False),
        lines,
    ]
    return processors, logging.Formatter("%(levelname)s: %(message)s")


def _as_json(process: str) -> Format:
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
    formatter = structlog.stdlib.ProcessorFormatter(
        foreign_pre_chain=common,
        processors=[structlog.stdlib.ProcessorFormatter.remove_processors_meta, json],
    )
    return [*common, json], formatter


FORMATS: dict[str, Callable[[str], Format]] = {"text": _as_text, "json": _as_json}
