"""Diagrams of matplotlib as SVG files: with one style, and each with a title and a description.

It is for authors of plug-ins whose pages and files have pictures. Lines, markers and hatches differ
as well as colours, so that readers need not distinguish series by colour alone.
"""

import io
import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from threading import Lock
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH_IN = 7.2
"""Width of every figure: the text of a page on A4 paper. [inch]"""

INK, MUTED, GRID = "#16202a", "#525e6b", "#d6dbe1"


class Drawing(NamedTuple):
    """A function that draws a picture on a figure of the usual width.

    Attributes:
        height_in: height of the figure [inch].
    """

    draw: "Callable[[Figure], None]"
    height_in: float = 3.4


class Mark(NamedTuple):
    """The style of one of several series: line, marker, hatch and colour."""

    colour: str
    line: tuple[int, tuple[float, ...]]
    marker: str
    hatch: str

    @property
    def style(self) -> dict[str, Any]:
        """Return matplotlib's arguments for a line with markers."""
        return {"color": self.colour, "linestyle": self.line, "marker": self.marker}


MARKS = (
    Mark("#0072b2", (0, ()), "o", "///"),
    Mark("#b34700", (0, (5.0, 2.0)), "s", "\\\\\\"),
    Mark("#00704f", (0, (1.2, 1.6)), "^", "|||"),
    Mark("#8f3a6c", (0, (6.0, 1.6, 1.2, 1.6)), "D", "---"),
    Mark("#16202a", (0, (3.0, 1.0, 1.0, 1.0, 1.0, 1.0)), "v", "xxx"),
    Mark("#7d5400", (0, (9.0, 2.0)), "P", "+++"),
    Mark("#4a3fa0", (0, (2.0, 1.0)), "X", "/-/"),
    Mark("#525e6b", (0, (9.0, 2.0, 2.0, 2.0)), "*", ".."),
)
"""Okabe and Ito's colours, darkened until each stands out from white by 4.5:1 or more."""

STYLE: dict[Any, Any] = {
    # Text stays text: it can be searched, and browsers choose a font that has its letters.
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Arial", "Liberation Sans", "sans-serif"],
    "font.size": 9.0,
    # A user's name with two dollar signs is a name, not a formula.
    "text.parse_math": False,
    "text.color": INK,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.labelcolor": INK,
    "axes.edgecolor": MUTED,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.unicode_minus": True,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "legend.handlelength": 3.2,
    "lines.linewidth": 1.6,
    "lines.markersize": 4.5,
    "hatch.linewidth": 0.6,
}

# The same values must give the same bytes: no date and no version of matplotlib.
NO_METADATA = dict.fromkeys(("Creator", "Date", "Format", "Type"))

HEAD = re.compile(r"^.*?(?=<svg)", re.DOTALL)
NAME = re.compile(r' id="([^"]+)"')
SIZE = re.compile(r'<svg xmlns:xlink="[^"]*" width="[\d.]+pt" height="[\d.]+pt"')

_one_at_a_time = Lock()


def pick_mark(place: int) -> Mark:
    """Return the style of the series at a place of a list, from 0."""
    return MARKS[place % len(MARKS)]


def draw_svg(name: str, title: str, alternative: str, drawing: Drawing) -> str:
    """Return a picture as an SVG file.

    Args:
        name: name of the picture, unique on a page, since the names of its parts follow from it.
        title: title of the picture.
        alternative: description of the picture in words.
        drawing: draws the picture.
    """
    with _use_style(name):
        from matplotlib.backends.backend_svg import FigureCanvasSVG
        from matplotlib.figure import Figure

        figure = Figure(figsize=(WIDTH_IN, drawing.height_in), layout="constrained")
        FigureCanvasSVG(figure)
        drawing.draw(figure)
        file = io.StringIO()
        figure.savefig(file, format="svg", metadata=NO_METADATA)
    return _describe(_tidy(file.getvalue()), name, title, alternative)


@contextmanager
def _use_style(name: str) -> Iterator[None]:
    import matplotlib as mpl

    # The style is a global of matplotlib, and the API draws in threads.
    with _one_at_a_time, warnings.catch_warnings(), mpl.rc_context({**STYLE, "svg.hashsalt": name}):
        # Names of campaigns may have letters that the font for measuring lacks; browsers have more.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        yield


def _tidy(svg: str) -> str:
    """Return the SVG without document type, fixed size, and unused ids."""
    bare = SIZE.sub('<svg xmlns:xlink="http://www.w3.org/1999/xlink"', HEAD.sub("", svg))
    return NAME.sub(lambda found: found[0] if f"#{found[1]}" in bare else "", bare)


def _describe(svg: str, name: str, title: str, alternative: str) -> str:
    """Add title and text alternative, as the accessibility guidelines for SVG want them."""
    description = (
        f'\n <title id="{name}-title">{escape(title)}</title>'
        f'\n <desc id="{name}-desc">{escape(alternative)}</desc>'
    )
    end = svg.index(">", svg.index("<svg"))
    names = f' role="img" aria-labelledby="{name}-title {name}-desc"'
    return svg[:end] + names + svg[end : end + 1] + description + svg[end + 1 :]
