"""The text of errors that plug-ins raise, made safe for messages, JSON and SQL.

Such text may hold lone surrogates, which UTF-8 cannot encode; NUL, which PostgreSQL refuses;
escape sequences, which a terminal obeys; or megabytes. The error's own `__str__` may raise.
"""

from typing import Any
from unicodedata import category

LONGEST_TEXT = 4_000
"""Characters that are kept of the text of one error; each errored episode stores its own."""

LONGEST_NAME = 200
KEPT = frozenset("\n\t")
UNSAFE = frozenset({"Cc", "Cs"})
"""Unicode categories: control characters and surrogates."""

CUT = " … (cut off)"


def clean_text(text: str, longest: int = LONGEST_TEXT) -> str:
    """Return the text without characters that a message, a log or a database refuses.

    Control characters other than newline and tab, and lone surrogates, become their Python escapes.

    Args:
        text: any text.
        longest: what is longer is cut off. [characters]
    """
    plain = "".join((text[: longest + 1],))  # an exact str, also of a subclass
    if not plain.isprintable():
        plain = "".join(map(_escape, plain))
    return plain if len(plain) <= longest else f"{plain[: longest - len(CUT)]}{CUT}"


def _escape(letter: str) -> str:
    if letter in KEPT or category(letter) not in UNSAFE:
        return letter
    return letter.encode("unicode_escape").decode("ascii")


def read_text(thing: object, longest: int = LONGEST_TEXT) -> str:
    """Return `str(thing)`, made safe, whatever the object does when it is asked for its text."""
    try:
        return clean_text(str(thing), longest)
    except (Exception, SystemExit):  # noqa: BLE001 - a stranger's `__str__` may raise anything
        return f"<the text of this {_type_name(thing)} cannot be read>"


def describe_error(error: BaseException) -> str:
    """Return the type and the text of an error, as in the last line of a traceback."""
    name, text = _type_name(error), read_text(error)
    return f"{name}: {text}" if text else name


def _type_name(thing: object) -> str:
    kind: Any = type(thing)
    try:
        return clean_text(kind.__name__, LONGEST_NAME)
    except (Exception, SystemExit):  # noqa: BLE001 - so may a metaclass
        return "object of an unnamed type"
