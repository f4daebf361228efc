"""What notebooks and tables can do with values; the values themselves stay plain."""

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd

MOST_ITEMS = 6
"""How much of a sequence a repr tells."""


class Shown:
    """A value that notebooks show as HTML; `eigenfail.notebook` says how."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        """The value for a notebook."""
        from eigenfail.notebook import html

        return html(self)


class Brief:
    """A value whose repr tells arrays by type and shape, and long sequences by their beginning."""

    __slots__ = ()
    __struct_fields__: ClassVar[tuple[str, ...]]

    def __repr__(self) -> str:
        """The value on few lines, however large it is."""
        fields = (f"{name}={brief(getattr(self, name))}" for name in self.__struct_fields__)
        return f"{type(self).__name__}({', '.join(fields)})"


class Tabular:
    """A value with a table in it; `eigenfail.frames` says which."""

    __slots__ = ()

    def to_pandas(self) -> "pd.DataFrame":
        """The table as a data frame; units are in the names of its columns, or in their documents.

        Raises:
            ServiceError: pandas is not installed.
        """
        from eigenfail.frames import to_pandas

        return to_pandas(self)

    def to_numpy(self) -> NDArray[np.generic]:
        """The table as a structured array with a field for each column; NaN where nothing is known.

        Of an analysis: the scores, shape (failures, components). Of noise: shape (steps, 2) [m].
        """
        from eigenfail.frames import to_numpy

        return to_numpy(self)


def brief(content: object) -> str:
    """An array as "float32 (100, 2)", a long tuple by its beginning, anything else by its repr."""
    if isinstance(content, np.ndarray):
        return f"<{content.dtype} {content.shape}>"
    if isinstance(content, tuple) and len(content) > MOST_ITEMS:
        first = ", ".join(map(repr, content[:MOST_ITEMS]))
        return f"({first}, … {len(content)} in all)"
    return repr(content)
