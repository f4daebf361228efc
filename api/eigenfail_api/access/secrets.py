"""Keys are shown to nobody: not in addresses, not in answers, not in logs."""

import logging
import traceback
from urllib.parse import unquote_plus

from starlette.types import Scope

from eigenfail.errors import InvalidValue
from eigenfail.values.access import SECRET, redacted

LOGGERS = ("uvicorn.error", "eigenfail.access", "asyncio")


def refuse_keys_in_address(scope: Scope) -> None:
    """Addresses are written down by proxies and browsers: a key in one is no secret any more.

    Raises:
        InvalidValue: there is one.
    """
    query = scope.get("query_string", b"").decode("latin-1")
    if SECRET.search(scope["path"]) or SECRET.search(unquote_plus(query)):
        raise InvalidValue(
            "address",
            "A key must not stand in an address, which others can read.",
            "Revoke that key, make another, and send it as `Authorization: Bearer ef_…`.",
        )


class Redacting(logging.Filter):
    """Takes keys out of what is logged, tracebacks too."""

    def filter(self, record: logging.LogRecord) -> bool:
        """Every record stays, with nothing in it that opens a door."""
        record.msg, record.args = redacted(record.getMessage()), ()
        if record.exc_info and not record.exc_text:
            record.exc_text = "".join(traceback.format_exception(*record.exc_info)).rstrip()
        if record.exc_text:
            record.exc_text = redacted(record.exc_text)
        return True


REDACTING = Redacting()


def redact_logs() -> None:
    """Have the loggers of this process take keys out; once is enough, and twice does no harm."""
    for name in LOGGERS:
        logging.getLogger(name).addFilter(REDACTING)
