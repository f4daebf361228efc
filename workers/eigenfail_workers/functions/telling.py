"""What an error says, in a line."""

from pathlib import Path
from traceback import extract_tb, format_exception_only


def last_line(error: BaseException) -> str:
    """The last line of its traceback, without a full stop."""
    return format_exception_only(error)[-1].strip().splitlines()[-1].rstrip(".")


def where(error: BaseException) -> str:
    """File and line in which it was raised."""
    frame = extract_tb(error.__traceback__)[-1]
    return f"{Path(frame.filename).name}, line {frame.lineno}"
