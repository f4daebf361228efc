"""The forms that values take in notebooks and tables; the values themselves stay plain."""

from collections.abc import Sized
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

import eigenfail

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa
    from matplotlib.axes import Axes

MOST_ITEMS = 6
"""Number of items of a sequence that a repr shows."""

MOST_CHARACTERS = 300
"""Maximum length of one field in a repr; the rest of longer content is left out [characters]."""


class Shown:
    """A value that notebooks show as HTML, which `eigenfail.presentation.notebook` writes."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        """The value for a notebook."""
        html: str = eigenfail.convert(self, "html")
        return html


class Brief:
    """A value with a short repr, so that the last line of a notebook's cell may be one.

    Arrays are shown by type and shape, long sequences and other large content by their beginning.
    """

    __slots__ = ()
    __struct_fields__: ClassVar[tuple[str, ...]]

    def __repr__(self) -> str:
        """The value on few lines, however large it is."""
        fields = (f"{name}={brief(getattr(self, name))}" for name in self.__struct_fields__)
        return f"{type(self).__name__}({', '.join(fields)})"


class Plottable:
    """A value with a diagram, which `eigenfail.presentation.plots` draws."""

    __slots__ = ()

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the value with matplotlib.

        Args:
            ax: axes into which it is drawn; None: a new figure.

        Returns:
            The axes, to go on drawing; their `figure` can be saved.

        Raises:
            InvalidValue: there is no result to draw.
            ServiceError: matplotlib is not installed.
        """
        drawn: Axes = eigenfail.convert(self, "plot", ax)
        return drawn


class Tabular:
    """A value with a table in it; `eigenfail.frames` says which."""

    __slots__ = ()

    def to_pandas(self) -> "pd.DataFrame":
        """The table as a data frame; units are in the names of its columns, or in their documents.

        Raises:
            ServiceError: pandas is not installed.
        """
        frame: pd.DataFrame = eigenfail.convert(self, "pandas")
        return frame

    def to_arrow(self) -> "pa.Table":
        """The table as an Arrow table; null where nothing is known, JSON in place of nested values.

        Raises:
            ServiceError: pyarrow is not installed.
        """
        table: pa.Table = eigenfail.convert(self, "arrow")
        return table

    def to_numpy(self) -> NDArray[np.generic]:
        """The table as a structured array with a field for each column; NaN where nothing is known.

        Of an analysis: the scores, shape (failures, components). Of noise: shape (steps,
        channels) [m].
        """
        table: NDArray[np.generic] = eigenfail.convert(self, "numpy")
        return table


def brief(content: object) -> str:
    """Return a field for a repr: arrays by type and shape, large content by its beginning."""
    if isinstance(content, np.ndarray):
        return f"<{content.dtype} {content.shape}>"
    if isinstance(content, tuple) and len(content) > MOST_ITEMS:
        first = ", ".join(map(brief, content[:MOST_ITEMS]))
        text = f"({first}, … {len(content)} in all)"
    else:
        text = repr(content)
    if isinstance(content, Brief) or len(text) <= MOST_CHARACTERS:
        return text
    size = f", {len(content)} in all" if isinstance(content, Sized) else ""
    return f"{text[:MOST_CHARACTERS]} … <{type(content).__name__}{size}>"
