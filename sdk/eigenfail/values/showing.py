"""Display of values: a short repr, and HTML from a plug-in in a notebook."""

import warnings
from collections.abc import Sized
from typing import ClassVar

import numpy as np

from eigenfail import plugins
from eigenfail.errors import EigenfailError

MOST_ITEMS = 6
"""Maximum number of items of a sequence in a repr."""

MOST_CHARACTERS = 300
"""Maximum length of one field in a repr; the rest of longer content is left out [characters]."""


class Shown:
    """A value that notebooks show as HTML if a plug-in that writes HTML is installed."""

    __slots__ = ()

    def _repr_html_(self) -> str | None:
        """Return the HTML for a notebook; None: the notebook shows the repr."""
        if "html" not in plugins.names(plugins.NOTEBOOKS):
            return None
        try:
            html: str = plugins.load(plugins.NOTEBOOKS, "html")(self)
        except EigenfailError as error:
            # A notebook would print a traceback above each value.
            warnings.warn(f"Values are shown without tables: {error}", stacklevel=1)
            return None
        return html


class Brief:
    """A value with a short repr, so that a notebook's cell may end with it.

    The repr shows the type and shape of arrays, and the beginning of long sequences and other large
    content.
    """

    __slots__ = ()
    __struct_fields__: ClassVar[tuple[str, ...]]

    def __repr__(self) -> str:
        """Return a short representation, even of a large value."""
        fields = (f"{name}={brief(getattr(self, name))}" for name in self.__struct_fields__)
        return f"{type(self).__name__}({', '.join(fields)})"


def brief(content: object) -> str:
    """Return a field for a repr: arrays by type and shape, large content by its beginning."""
    if isinstance(content, np.ndarray):
        return f"<{content.dtype} {content.shape}>"
    if isinstance(content, tuple) and len(content) > MOST_ITEMS:
        first = ", ".join(map(brief, content[:MOST_ITEMS]))
        text = f"({first}, … {len(content)} in all)"
    else:
        text = repr(content)
    # The repr of a brief value is made of fields that were cut already.
    if isinstance(content, Brief) or len(text) <= MOST_CHARACTERS:
        return text
    size = f", {len(content)} in all" if isinstance(content, Sized) else ""
    return f"{text[:MOST_CHARACTERS]} … <{type(content).__name__}{size}>"
