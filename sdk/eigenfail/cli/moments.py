"""Dates and times, as people write them."""

from datetime import UTC, datetime

FORM = "%Y-%m-%d %H:%M:%S"


def moment(at_ms: int) -> str:
    """A time in the reader's zone; milliseconds since 1970."""
    return in_utc(at_ms).astimezone().strftime(FORM)


def utc(at_ms: int) -> str:
    """The same in UTC, for what people in several zones read."""
    return in_utc(at_ms).strftime(FORM)


def in_utc(at_ms: int) -> datetime:
    """The time itself."""
    return datetime.fromtimestamp(at_ms / 1_000, UTC)
