"""Drawings as SVG: the same bytes for the same numbers, readable without colour.

matplotlib is loaded when the first picture is drawn. It has one set of style parameters for the
whole process, so pictures are drawn one at a time.
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
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH_IN = 7.2
INK, MUTED, GRID = "#16202a", "#525e6b", "#d6dbe1"


Draw = Callable[["Figure"], None]


class Drawing(NamedTuple):
    """What is drawn, on a figure of the usual width.

    Attributes:
        height_in: of the figure [inch].
    """

    draw: Draw
    height_in: float = 3.4


class Mark(NamedTuple):
    """How one of several things is drawn: told apart by line, marker and hatch, and by colour."""

    colour: str
    line: tuple[int, tuple[float, ...]]
    marker: str
    hatch: str

    @property
    def style(self) -> dict[str, Any]:
        """Of a line through marks, as matplotlib takes it."""
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
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Arial", "Liberation Sans", "sans-serif"],
    "font.size": 9.0,
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
NO_METADATA = dict.fromkeys(("Creator", "Date", "Format", "Type"))

HEAD = re.compile(r"^.*?(?=<svg)", re.DOTALL)
NAME = re.compile(r' id="([^"]+)"')
SIZE = re.compile(r'<svg xmlns:xlink="[^"]*" width="[\d.]+pt" height="[\d.]+pt"')
NAMESPACES = re.compile(r' xmlns(:xlink)?="[^"]*"')
STYLE_ELEMENT = re.compile(r"\s*<defs>\s*<style.*?</style>\s*</defs>", re.DOTALL)

_one_at_a_time = Lock()


def mark(place: int) -> Mark:
    """How the thing at this place of a list is drawn."""
    return MARKS[place % len(MARKS)]


def draw(name: str, title: str, alternative: str, drawing: Drawing) -> str:
    """The picture as an SVG file.

    Args:
        name: of the picture; one of its kind on a page, for the names inside it follow from it.
        title: what it shows.
        alternative: what is to be seen, in words.
        drawing: draws it.
    """
    with use_style(name):
        from matplotlib.backends.backend_svg import FigureCanvasSVG
        from matplotlib.figure import Figure

        figure = Figure(figsize=(WIDTH_IN, drawing.height_in), layout="constrained")
        FigureCanvasSVG(figure)
        drawing.draw(figure)
        file = io.StringIO()
        figure.savefig(file, format="svg", metadata=NO_METADATA)
    return describe_svg(tidy_svg(file.getvalue()), name, title, alternative)


@contextmanager
def use_style(name: str) -> Iterator[None]:
    """matplotlib in our style, used by nobody else meanwhile."""
    import matplotlib as mpl

    with _one_at_a_time, warnings.catch_warnings(), mpl.rc_context({**STYLE, "svg.hashsalt": name}):
        # Names of campaigns may have letters that the font for measuring lacks; browsers have more.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        yield


def tidy_svg(svg: str) -> str:
    """Without document type, fixed size, and names that nothing refers to."""
    bare = SIZE.sub('<svg xmlns:xlink="http://www.w3.org/1999/xlink"', HEAD.sub("", svg))
    return NAME.sub(lambda found: found[0] if f"#{found[1]}" in bare else "", bare)


def describe_svg(svg: str, name: str, title: str, alternative: str) -> str:
    """With title and text alternative, as the accessibility guidelines for SVG want them."""
    told = (
        f'\n <title id="{name}-title">{escape(title)}</title>'
        f'\n <desc id="{name}-desc">{escape(alternative)}</desc>'
    )
    end = svg.index(">", svg.index("<svg"))
    names = f' role="img" aria-labelledby="{name}-title {name}-desc"'
    return svg[:end] + names + svg[end : end + 1] + told + svg[end + 1 :]


def inline(svg: str) -> str:
    """The same as an element of an HTML page, which needs no namespaces and has a style sheet."""
    return NAMESPACES.sub("", STYLE_ELEMENT.sub("", svg, count=1)).replace("xlink:href", "href")


def legend(axes: "Axes", columns: int = 1) -> None:
    """Above the drawing, where it hides nothing."""
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, borderaxespad=0.2)
