"""Scalable drawings by hand: a few elements, and one palette for light and dark pages."""

from collections.abc import Iterable, Sequence
from html import escape
from typing import NamedTuple

WIDTH = 960

STYLE = """
  .page { fill: #ffffff } .road { fill: #e7e9ee } .lost { fill: #fbe3c8 }
  .line { stroke: #8a93a3; fill: none } .faint { stroke-opacity: 0.35 }
  .truck { fill: #2563a8 } .car { fill: #f0a868 }
  .dot { fill: #5b1f94 }
  .true { stroke: #1d2430; stroke-width: 2; fill: none }
  .believed { stroke: #2563a8; stroke-width: 2.5; fill: none }
  text { font: 13px system-ui, sans-serif; fill: #1d2430 }
  @media (prefers-color-scheme: dark) {
    .page { fill: #14181f } .road { fill: #2a303b } .lost { fill: #4a3420 }
    .line { stroke: #7c8596 } .truck { fill: #6aaaf0 } .car { fill: #a3591f }
    .dot { fill: #e2ccff } .true { stroke: #e6e9ef }
    .believed { stroke: #6aaaf0 } text { fill: #e6e9ef }
  }"""


class Point(NamedTuple):
    """A place on the page, from its upper left corner [px]."""

    x: float
    y: float


def page(height: float, title: str, drawn: Iterable[str]) -> str:
    """A picture of the usual width, on a ground of its own."""
    size = f'viewBox="0 0 {WIDTH} {height:.0f}"'
    return "\n".join(
        (
            f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img">',
            f"<title>{escape(title)}</title>",
            f"<style>{STYLE}\n</style>",
            f'<rect class="page" width="{WIDTH}" height="{height:.0f}" rx="8"/>',
            *drawn,
            "</svg>\n",
        )
    )


def text(at: Point, words: str, anchor: str = "start") -> str:
    """One line of text."""
    return f'<text x="{at.x:.1f}" y="{at.y:.1f}" text-anchor="{anchor}">{escape(words)}</text>'


def box(corner: Point, width: float, height: float, css: str) -> str:
    """A rectangle by its upper left corner."""
    place = f'x="{corner.x:.1f}" y="{corner.y:.1f}"'
    return f'<rect class="{css}" {place} width="{width:.1f}" height="{height:.1f}"/>'


def turned_box(centre: Point, length: float, width: float, degrees: float, css: str) -> str:
    """A rectangle by its centre, turned clockwise."""
    where = f"translate({centre.x:.1f} {centre.y:.1f}) rotate({degrees:.2f})"
    size = f'x="{-length / 2:.1f}" y="{-width / 2:.1f}" width="{length:.1f}" height="{width:.1f}"'
    return f'<rect class="{css}" transform="{where}" {size} rx="2"/>'


def line(points: Sequence[Point], css: str) -> str:
    """A line through points."""
    path = " ".join(f"{point.x:.1f},{point.y:.1f}" for point in points)
    return f'<polyline class="{css}" points="{path}"/>'


def dot(at: Point, radius: float = 2.0) -> str:
    """A dot."""
    return f'<circle class="dot" cx="{at.x:.1f}" cy="{at.y:.1f}" r="{radius}"/>'
