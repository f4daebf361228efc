"""Learning curves: how a method's failures come, by each hundred of its episodes."""

from collections.abc import Iterable, Sequence
from math import isfinite
from pathlib import Path
from statistics import median

import msgspec
from benchmarks.figures import RESULTS, ROOT
from benchmarks.pictures.svg import Point, line, page, text
from benchmarks.searches import Found

BLOCK = 100
FILE = RESULTS / "learning_curves.json"
PICTURE = ROOT / "docs" / "pictures" / "learning.svg"

PANEL_WIDTH, PANEL_HEIGHT, MARGIN = 240.0, 150.0, 60.0


class Curve(msgspec.Struct, frozen=True):
    """One campaign by blocks of 100 episodes; None where a block has no failure.

    Attributes:
        failure_rate: share of the block's episodes that failed.
        log_p_per_step: of its failures.
        robustness_m: median over its episodes.
    """

    failure_rate: tuple[float, ...]
    log_p_per_step: tuple[float | None, ...]
    robustness_m: tuple[float | None, ...]


Curves = dict[str, tuple[Curve, ...]]
"""A curve for each seed, by the method's name."""


class Panel(msgspec.Struct, frozen=True):
    """One of the three graphs of a method."""

    field: str
    title: str
    low: float
    high: float


PANELS = (
    Panel("failure_rate", "failure rate", 0.0, 1.0),
    Panel("log_p_per_step", "log p per step of failures", -4.0, 0.0),
    Panel("robustness_m", "median robustness [m]", 0.0, 20.0),
)


def curve(run: Found) -> Curve:
    """The curve of a campaign."""
    blocks = range(0, len(run.crashed), BLOCK)
    return Curve(
        failure_rate=tuple(_share(run.crashed[first : first + BLOCK]) for first in blocks),
        log_p_per_step=tuple(_log_p(run, first) for first in blocks),
        robustness_m=tuple(_middle(run.robustness_m[first : first + BLOCK]) for first in blocks),
    )


def read(path: Path = FILE) -> Curves:
    """What is kept."""
    return msgspec.json.decode(path.read_bytes(), type=Curves) if path.exists() else {}


def write(curves: Curves, path: Path = FILE) -> None:
    """Replace what is kept."""
    data = msgspec.json.encode(dict(sorted(curves.items())))
    path.write_bytes(msgspec.json.format(data, indent=2) + b"\n")


def picture(curves: Curves) -> str:
    """A row of three graphs for each method, a line for each seed."""
    height = MARGIN + len(curves) * (PANEL_HEIGHT + MARGIN)
    rows = (row(i, name, of_seeds) for i, (name, of_seeds) in enumerate(sorted(curves.items())))
    return page(height, "Learning curves", (part for parts in rows for part in parts))


def row(number: int, name: str, of_seeds: Sequence[Curve]) -> Iterable[str]:
    """The graphs of one method."""
    top = MARGIN + number * (PANEL_HEIGHT + MARGIN)
    for place, panel in enumerate(PANELS):
        corner = Point(MARGIN + place * (PANEL_WIDTH + MARGIN), top)
        yield text(Point(corner.x, top - 10), f"{name}: {panel.title}")
        yield from frame(corner, panel, len(of_seeds[0].failure_rate) * BLOCK)
        for one in of_seeds:
            yield from trace(corner, panel, getattr(one, panel.field))


def frame(corner: Point, panel: Panel, episodes: int) -> Iterable[str]:
    """The axes of a graph, and what they end at."""
    foot, right = corner.y + PANEL_HEIGHT, corner.x + PANEL_WIDTH
    yield line([corner, Point(corner.x, foot), Point(right, foot)], "line")
    yield text(Point(corner.x - 6, corner.y + 10), f"{panel.high:g}", "end")
    yield text(Point(corner.x - 6, foot), f"{panel.low:g}", "end")
    yield text(Point(right, foot + 16), f"{episodes} episodes", "end")


def trace(corner: Point, panel: Panel, values: Sequence[float | None]) -> Iterable[str]:
    """The line of one seed, in the middle of each block; broken where there is no value."""
    width = PANEL_WIDTH / len(values)
    pieces: list[list[Point]] = [[]]
    for i, value in enumerate(values):
        if value is None or not isfinite(value):
            pieces.append([])
            continue
        inside = min(max(value, panel.low), panel.high)
        share = (inside - panel.low) / (panel.high - panel.low)
        x = corner.x + (i + 0.5) * width
        pieces[-1].append(Point(x, corner.y + PANEL_HEIGHT * (1.0 - share)))
    return [line(piece, "believed") for piece in pieces if piece]


def _share(crashed: Sequence[bool]) -> float:
    return sum(crashed) / len(crashed)


def _middle(values: Sequence[float]) -> float | None:
    known = [value for value in values if isfinite(value)]
    return median(known) if known else None


def _log_p(run: Found, first: int) -> float | None:
    before = sum(run.crashed[:first])
    here = run.crashes[before : before + sum(run.crashed[first : first + BLOCK])]
    steps = sum(len(one.z) for one in here)
    return sum(one.log_probability for one in here) / steps if steps else None
