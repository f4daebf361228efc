"""TOML files, as tables."""

import tomllib
from pathlib import Path
from typing import Any

from eigenfail.errors import InvalidValue


def read_toml(file: Path, like: str) -> dict[str, Any]:
    """The table in a file.

    Args:
        file: its path.
        like: what such a file should be: the remedy of every error.

    Raises:
        InvalidValue: it cannot be read, or is not TOML.
    """
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise InvalidValue(str(file), f"cannot be read: {error.strerror}.", like) from error
    # tomllib gives up on deep nesting and on endless integers in errors of its own.
    except (ValueError, RecursionError) as error:
        raise InvalidValue(str(file), f"is not TOML: {error}.", like) from error
