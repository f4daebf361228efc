"""A chart, the numbers that it draws, and the table behind it."""

from collections.abc import Iterable

import msgspec
import numpy as np

DIGITS = 5
MOST_ROWS = 200


class Chart(msgspec.Struct, frozen=True):
    """What a browser draws, and what is read where nothing is drawn.

    Attributes:
        id: of its element on the page.
        kind: which module draws it.
        title: what it shows.
        caption: how to read it, in a sentence.
        data: for the module, plain JSON.
        columns: of the table.
        rows: of the table, as text.
        note: what the table leaves out.
    """

    id: str
    kind: str
    title: str
    caption: str
    data: dict[str, object]
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


def rounded(values: Iterable[float | None]) -> list[float | None]:
    """Floats with as many digits as a screen can show."""
    return [None if value is None else float(f"{value:.{DIGITS}g}") for value in values]


def rounded_rows(array: np.ndarray) -> list[list[float | None]]:
    """The rows of a matrix, likewise."""
    return [rounded(float(value) for value in row) for row in array]
