"""What commands print: JSON for programs, tables for people."""

from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import typer
from rich.console import Console, RenderableType

PLAIN_WIDTH = 1_000
"""Of pipes and files: no row is broken there. [characters]"""


def plain(value: Any) -> Any:
    """An array as nested lists, for JSON."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} has no JSON form.")


def to_json(value: Any, indent: int = 2) -> str:
    """A value of ours as JSON; on one line with an indent of 0."""
    return msgspec.json.format(msgspec.json.encode(value, enc_hook=plain), indent=indent).decode()


def console() -> Console:
    """Where tables go; wide enough to keep every row on one line when nobody looks."""
    screen = Console(highlight=False)
    return screen if screen.is_terminal else Console(highlight=False, width=PLAIN_WIDTH)


def show(value: Any, as_json: bool, draw: Callable[[], RenderableType]) -> None:
    """Print a value: as JSON, or as it is drawn for people."""
    if as_json:
        typer.echo(to_json(value))
        return
    console().print(draw())
