"""The graph of an argument as an SVG picture, in layers from the top claim down.

Shapes follow the Goal Structuring Notation. A goal is a rectangle, a strategy a parallelogram, a
solution a circle. A context is a rectangle with round ends, an assumption an ellipse with an A. A
diamond below a goal says that it is undeveloped. SupportedBy has a filled arrowhead, InContextOf an
open one. Verdicts are written out; in addition, refuted elements have a cross and a double border,
and undecided ones a dashed border.
"""

import html
from collections.abc import Callable, Iterator, Mapping
from math import ceil, hypot, sqrt
from textwrap import wrap
from typing import NamedTuple

from eigenfail.gate.report import ILLEGAL
from eigenfail_assurance.evidence import argument
from eigenfail_assurance.evidence.judgement import ClaimVerdict

INK, MUTED, PAPER = "#16202a", "#525e6b", "#ffffff"
FILLS = {
    ClaimVerdict.SUPPORTED: "#e3f2e6",
    ClaimVerdict.REFUTED: "#fbe3dc",
    ClaimVerdict.UNDECIDED: "#f6f1d5",
    ClaimVerdict.UNDEVELOPED: "#ffffff",
}

LETTER, LINE, MARGIN = 6.3, 15.0, 12.0
"""Mean width of a letter, height of a line, and room around a text. [px]"""

COLUMNS = {
    argument.ElementKind.GOAL: 38,
    argument.ElementKind.STRATEGY: 36,
    argument.ElementKind.SOLUTION: 24,
    argument.ElementKind.CONTEXT: 50,
    argument.ElementKind.ASSUMPTION: 42,
}
"""Letters on a line, by kind of element."""

SLANT = 18.0
"""By how much the upper edge of a parallelogram is moved to the right. [px]"""

DIAMOND = 9.0
"""Half the width of the diamond of an undeveloped goal. [px]"""

ACROSS, DOWN, BESIDE, STACK = 36.0, 64.0, 56.0, 14.0
"""Gaps between neighbours, layers, a goal and what is beside it, and elements above another.
[px]"""

DOUBLE = 4.0
"""Distance between the two borders of a refuted element. [px]"""


class _Box(NamedTuple):
    """An element with its lines of text and its size. [px]"""

    element: argument.ArgumentElement
    lines: tuple[str, ...]
    width: float
    height: float


class _Place(NamedTuple):
    """A box with its centre. [px]"""

    box: _Box
    x: float
    y: float


class _Extent(NamedTuple):
    """How far a subtree reaches from the centre of its top element. [px]"""

    left: float
    right: float


def draw_graph(graph: argument.ArgumentGraph) -> str:
    """Return the picture of an argument, as SVG with a title and a description."""
    layout = _Layout(graph)
    places = layout.place_elements()
    left = min(each.x - each.box.width / 2.0 for each in places.values()) - MARGIN
    right = max(each.x + each.box.width / 2.0 for each in places.values()) + MARGIN
    low = max(each.y + each.box.height / 2.0 for each in places.values())
    height = low + 2.0 * DIAMOND + MARGIN
    view = " ".join(map(_format, (left, -MARGIN, right - left, height + MARGIN)))
    opening = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{view}" '
        f'width="{ceil(right - left)}" height="{ceil(height + MARGIN)}" role="img" '
        'aria-labelledby="argument-title argument-description" '
        'font-family="system-ui, Segoe UI, Noto Sans, Arial, sans-serif" font-size="12">'
    )
    ground = f'width="100%" height="100%" fill="{PAPER}"'
    parts = (
        opening,
        f'<title id="argument-title">Argument: {_escape(graph.name)}</title>',
        f'<desc id="argument-description">{_escape(describe_graph(graph))}</desc>',
        f'<rect x="{_format(left)}" y="{_format(-MARGIN)}" {ground}/>',
        _ARROWS,
        *(_draw_link(places[e.source], places[e.target], e.kind) for e in graph.links),
        *(part for place in places.values() for part in _draw_element(place)),
        "</svg>\n",
    )
    return "\n".join(parts)


def describe_graph(graph: argument.ArgumentGraph) -> str:
    """Return the claims of an argument with their verdicts, in sentences."""
    goals = [each for each in graph.elements if each.kind is argument.ElementKind.GOAL]
    return " ".join(f"{each.id}, {each.verdict}: {each.text}" for each in goals)


_ARROWS = (
    "<defs>"
    '<marker id="supported" viewBox="0 0 10 10" refX="10" refY="5" markerWidth="9" '
    f'markerHeight="9" orient="auto"><path d="M0 0 L10 5 L0 10 z" fill="{INK}"/></marker>'
    '<marker id="context" viewBox="-1 -1 12 12" refX="10" refY="5" markerWidth="10" '
    f'markerHeight="10" orient="auto"><path d="M0 0 L10 5 L0 10 z" fill="{PAPER}" '
    f'stroke="{INK}" stroke-width="1.2"/></marker></defs>'
)


def _escape(text: str) -> str:
    """Return a text for XML, without characters that XML does not have."""
    return html.escape(ILLEGAL.sub("\ufffd", text))


def _format(value: float) -> str:
    return f"{value:.1f}".removesuffix(".0")


def _measure_element(element: argument.ArgumentElement) -> _Box:
    """Return an element with its size, as its text and its shape need it."""
    heading = element.id if element.verdict is None else f"{element.id} · {element.verdict}"
    lines = (heading, *wrap(element.text, COLUMNS[element.kind], break_long_words=True))
    width = LETTER * max(map(len, lines)) + 2.0 * MARGIN
    height = LINE * len(lines) + MARGIN
    if element.kind is argument.ElementKind.STRATEGY:
        width += 2.0 * SLANT
    if element.kind is argument.ElementKind.SOLUTION:
        width = height = hypot(width - MARGIN, height - MARGIN) + MARGIN
    if element.kind is argument.ElementKind.ASSUMPTION:
        # The smallest ellipse about a rectangle is the square root of 2 times as wide and high.
        width, height = sqrt(2.0) * (width - MARGIN), sqrt(2.0) * height
    return _Box(element, lines, width, height)


class _Layout:
    """Places of all elements: claims in layers, contexts left of them, assumptions right."""

    def __init__(self, graph: argument.ArgumentGraph) -> None:
        self._boxes = {each.id: _measure_element(each) for each in graph.elements}
        self._below: dict[str, list[str]] = {each: [] for each in self._boxes}
        self._beside: dict[str, list[str]] = {each: [] for each in self._boxes}
        for link in graph.links:
            joined = self._below if link.kind is argument.LinkKind.SUPPORTED_BY else self._beside
            joined[link.source].append(link.target)
        self._top = graph.elements[0].id
        self._layers: list[float] = []
        self._places: dict[str, _Place] = {}

    def place_elements(self) -> Mapping[str, _Place]:
        """Return the places by id, in the order of the elements."""
        self._measure_layers(self._top, 0)
        self._place(self._top, self._measure_subtree(self._top).left, 0)
        return {each: self._places[each] for each in self._boxes}

    def _list_beside(self, name: str, kind: argument.ElementKind) -> list[_Box]:
        boxes = (self._boxes[each] for each in self._beside[name])
        return [each for each in boxes if each.element.kind is kind]

    def _measure_layers(self, name: str, depth: int) -> None:
        """Find the height of each layer."""
        heights = [self._boxes[name].height]
        for kind in (argument.ElementKind.CONTEXT, argument.ElementKind.ASSUMPTION):
            stack = self._list_beside(name, kind)
            heights.append(sum(each.height + STACK for each in stack))
        if depth == len(self._layers):
            self._layers.append(0.0)
        self._layers[depth] = max(self._layers[depth], *heights)
        for each in self._below[name]:
            self._measure_layers(each, depth + 1)

    def _measure_block(self, name: str) -> _Extent:
        """Return the extent of an element and its contexts on both sides of its centre."""
        half = self._boxes[name].width / 2.0
        sides = [
            max((each.width + BESIDE for each in self._list_beside(name, kind)), default=0.0)
            for kind in (argument.ElementKind.CONTEXT, argument.ElementKind.ASSUMPTION)
        ]
        return _Extent(half + sides[0], half + sides[1])

    def _measure_subtree(self, name: str) -> _Extent:
        own, below = self._measure_block(name), self._measure_row(name)
        return _Extent(max(own.left, below.left), max(own.right, below.right))

    def _measure_row(self, name: str) -> _Extent:
        """Return how far the subtrees below an element reach from its centre."""
        extents = [self._measure_subtree(each) for each in self._below[name]]
        if not extents:
            return _Extent(0.0, 0.0)
        width = sum(each.left + each.right for each in extents) + ACROSS * (len(extents) - 1)
        middle = (extents[0].left + width - extents[-1].right) / 2.0
        return _Extent(middle, width - middle)

    def _place(self, name: str, x: float, depth: int) -> None:
        top = sum(self._layers[:depth]) + DOWN * depth
        box = self._boxes[name]
        self._places[name] = _Place(box, x, top + box.height / 2.0)
        self._place_beside(name, x, top)
        left = x - self._measure_row(name).left
        for each in self._below[name]:
            extent = self._measure_subtree(each)
            self._place(each, left + extent.left, depth + 1)
            left += extent.left + extent.right + ACROSS

    def _place_beside(self, name: str, x: float, top: float) -> None:
        half = self._boxes[name].width / 2.0 + BESIDE
        for kind, way in (
            (argument.ElementKind.CONTEXT, -1.0),
            (argument.ElementKind.ASSUMPTION, 1.0),
        ):
            stack = self._list_beside(name, kind)
            y = top
            for box in stack:
                at = x + way * (half + box.width / 2.0)
                self._places[box.element.id] = _Place(box, at, y + box.height / 2.0)
                y += box.height + STACK


def _draw_link(source: _Place, target: _Place, kind: argument.LinkKind) -> str:
    if kind is argument.LinkKind.SUPPORTED_BY:
        points, marker = _route_down(source, target), "supported"
    else:
        way = 1.0 if target.x > source.x else -1.0
        begin = (source.x + way * (source.box.width / 2.0 + _find_border(source)), source.y)
        points = (begin, (target.x - way * target.box.width / 2.0, target.y))
        marker = "context"
    places = " ".join(f"{_format(x)},{_format(y)}" for x, y in points)
    return f'<polyline points="{places}" fill="none" stroke="{INK}" marker-end="url(#{marker})"/>'


def _route_down(source: _Place, target: _Place) -> tuple[tuple[float, float], ...]:
    """Return the corners of a link that runs across in the gap between two layers alone."""
    diamond = 2.0 * DIAMOND if source.box.element.undeveloped else 0.0
    begin = source.y + source.box.height / 2.0 + diamond + _find_border(source)
    top = target.y - target.box.height / 2.0
    middle, end = top - DOWN / 2.0, top - _find_border(target)
    return ((source.x, begin), (source.x, middle), (target.x, middle), (target.x, end))


def _find_border(place: _Place) -> float:
    """Return by how much a second border makes an element larger on each side. [px]"""
    return DOUBLE if place.box.element.verdict is ClaimVerdict.REFUTED else 0.0


def _draw_element(place: _Place) -> Iterator[str]:
    element, box = place.box.element, place.box
    verdict = element.verdict
    words = f"{element.kind} {element.id}" + (f", {verdict}" if verdict else "")
    yield f'<g id="{_escape(element.id)}"><title>{_escape(words)}: {_escape(element.text)}</title>'
    fill = FILLS[verdict] if verdict else PAPER
    dash = ' stroke-dasharray="6 3"' if verdict is ClaimVerdict.UNDECIDED else ""
    look = f'fill="{fill}" stroke="{INK}" stroke-width="1.4"{dash}'
    outline = _OUTLINES[element.kind]
    if verdict is ClaimVerdict.REFUTED:
        yield outline(place, box.width + 2.0 * DOUBLE, box.height + 2.0 * DOUBLE, look)
    yield outline(place, box.width, box.height, look)
    if element.undeveloped:
        yield _draw_diamond(place)
    if verdict is ClaimVerdict.REFUTED:
        yield _draw_cross(place)
    yield from _draw_text(place)
    yield "</g>"


def _draw_rectangle(place: _Place, width: float, height: float, look: str) -> str:
    return _draw_round_rectangle(place, width, height, look, radius=0.0)


def _draw_context(place: _Place, width: float, height: float, look: str) -> str:
    return _draw_round_rectangle(place, width, height, look, radius=16.0)


def _draw_round_rectangle(
    place: _Place, width: float, height: float, look: str, *, radius: float
) -> str:
    x, y = place.x - width / 2.0, place.y - height / 2.0
    size = f'width="{_format(width)}" height="{_format(height)}"'
    return f'<rect x="{_format(x)}" y="{_format(y)}" {size} rx="{_format(radius)}" {look}/>'


def _draw_parallelogram(place: _Place, width: float, height: float, look: str) -> str:
    half, up = width / 2.0, height / 2.0
    corners = ((SLANT - half, -up), (half, -up), (half - SLANT, up), (-half, up))
    points = " ".join(f"{_format(place.x + x)},{_format(place.y + y)}" for x, y in corners)
    return f'<polygon points="{points}" {look}/>'


def _draw_ellipse(place: _Place, width: float, height: float, look: str) -> str:
    size = f'rx="{_format(width / 2.0)}" ry="{_format(height / 2.0)}"'
    return f'<ellipse cx="{_format(place.x)}" cy="{_format(place.y)}" {size} {look}/>'


_OUTLINES: Mapping[argument.ElementKind, Callable[[_Place, float, float, str], str]] = {
    argument.ElementKind.GOAL: _draw_rectangle,
    argument.ElementKind.STRATEGY: _draw_parallelogram,
    argument.ElementKind.SOLUTION: _draw_ellipse,
    argument.ElementKind.CONTEXT: _draw_context,
    argument.ElementKind.ASSUMPTION: _draw_ellipse,
}


def _draw_diamond(place: _Place) -> str:
    top = place.y + place.box.height / 2.0
    corners = ((0.0, 0.0), (DIAMOND, DIAMOND), (0.0, 2.0 * DIAMOND), (-DIAMOND, DIAMOND))
    points = " ".join(f"{_format(place.x + x)},{_format(top + y)}" for x, y in corners)
    return f'<polygon points="{points}" fill="{PAPER}" stroke="{INK}" stroke-width="1.4"/>'


def _draw_cross(place: _Place) -> str:
    """Return a cross in front of the heading."""
    x = place.x - LETTER * len(place.box.lines[0]) / 2.0 - 14.0
    y = _find_first_line(place) - 4.0
    strokes = f"M{_format(x - 4)} {_format(y - 4)} l8 8 m0 -8 l-8 8"
    return f'<path d="{strokes}" stroke="{INK}" stroke-width="2.4" fill="none"/>'


def _find_first_line(place: _Place) -> float:
    return place.y - LINE * len(place.box.lines) / 2.0 + LINE - 4.0


def _draw_text(place: _Place) -> Iterator[str]:
    """Yield the lines of an element, centred; the first one is its heading."""
    x, y = _format(place.x), _find_first_line(place)
    for number, line in enumerate(place.box.lines):
        weight = "" if number else ' font-weight="bold"'
        at = f'x="{x}" y="{_format(y + LINE * number)}"'
        yield f'<text {at} text-anchor="middle" fill="{INK}"{weight}>{_escape(line)}</text>'
    if place.box.element.kind is argument.ElementKind.ASSUMPTION:
        at_x, at_y = place.x + place.box.width * 0.42, place.y + place.box.height * 0.48
        where = f'x="{_format(at_x)}" y="{_format(at_y)}"'
        yield f'<text {where} fill="{MUTED}" font-weight="bold">A</text>'
