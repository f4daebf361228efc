"""Which moments matter: how much each step weighs in the components (paper, PCA)."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from eigenfail.values import AXES
from eigenfail.values.report import Cell, ReportPicture, ReportSection
from eigenfail_services.reports import formats
from eigenfail_services.reports.analysed import Analysed, analysed
from eigenfail_services.reports.material import Material
from eigenfail_services.reports.parts import Drawing, Part, table
from eigenfail_services.reports.pictures import legend, mark

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLE = "influence"
COLUMNS = (
    ("campaign", "Campaign"),
    ("step", "Step"),
    ("time_s", "Time", "s"),
    *((axis, f"{axis.capitalize()} influence") for axis in AXES),
)
WORDS = (
    "The influence of a step is the size of its entries in the components, each weighted with the "
    "variance that it explains. Where it is large, failures differ most in their noise."
)


def part(material: Material) -> Part | None:
    """The influence of every campaign that was analysed."""
    found = [each for each in analysed(material) if each.result.influence.any()]
    if not found:
        return None
    rows = [row for each in found for row in steps(each)]
    section = ReportSection(
        name="influence",
        title="Influence over time",
        words=(WORDS, *(sentence for each in found for sentence in told(each))),
        tables=(table(TABLE, "Influence of each step", COLUMNS, rows),),
        pictures=tuple(map(picture, found)),
    )
    return Part(section, drawings={picture(each).name: drawing(each) for each in found})


def told(found: Analysed) -> Iterator[str]:
    """The moments that matter most, in seconds before the collision."""
    moments = [*filter(None, (when(found, axis) for axis in AXES))]
    if moments:
        yield f"Campaign {found.subject.id}, seconds before the collision: {'; '.join(moments)}."
    shares = [
        f"the last {each.seconds:g} s are {formats.percent(each.time)} of the time and hold "
        f"{formats.percent(each.both)} of the influence"
        for each in found.result.before_collision
    ]
    if shares:
        yield f"Campaign {found.subject.id}, before the collision: {'; '.join(shares)}."


def when(found: Analysed, axis: str) -> str:
    """The moments of an axis; empty if none is known."""
    known = [
        formats.number(each.before_collision_s)
        for each in found.result.moments
        if each.axis == axis and each.before_collision_s is not None
    ]
    return f"{axis} noise matters most at {', '.join(known)}" if known else ""


def places(found: Analysed) -> NDArray[np.float64]:
    """The time of each step, or its number where no time is known.

    From the start, or to the collision if the failures stand side by side there.
    """
    steps = np.arange(len(found.result.influence), dtype=float)
    origin = len(steps) if found.at_collision else 0
    return (steps - origin) * (found.step_s or 1.0)


def axis_title(found: Analysed) -> str:
    """What the places are."""
    unit = "time [s]" if found.step_s else "step"
    return f"{unit}; 0 is the collision" if found.at_collision else unit


def steps(found: Analysed) -> Iterator[tuple[Cell, ...]]:
    """A row for each step."""
    for step, (at, weights) in enumerate(
        zip(places(found), found.result.influence.astype(float), strict=True)
    ):
        time_s = float(at) if found.step_s else None
        yield (found.subject.id, step, time_s, *(float(weight) for weight in weights))


def picture(found: Analysed) -> ReportPicture:
    """When noise matters, in words."""
    at, weights = places(found), found.result.influence
    told = (
        f"{axis} influence is largest at "
        f"{moment(found, float(at[int(np.argmax(weights[:, way]))]))}"
        for way, axis in enumerate(AXES)
    )
    return ReportPicture(
        name=f"influence-{found.name}",
        title=f"Influence over time, campaign {found.subject.label}",
        alternative=f"{'; '.join(told)}.".capitalize(),
        table=TABLE,
        campaigns=(found.subject.id,),
    )


def moment(found: Analysed, at: float) -> str:
    """A place on the axis, in words."""
    return f"{formats.number(at)} s" if found.step_s else f"step {at:g}"


def drawing(found: Analysed) -> Drawing:
    """A line for each axis."""

    def draw(figure: "Figure") -> None:
        axes = figure.subplots()
        for way, axis in enumerate(AXES):
            look = mark(way)
            weights = found.result.influence[:, way]
            axes.plot(places(found), weights, color=look.colour, linestyle=look.line, label=axis)
        axes.set_xlabel(axis_title(found))
        axes.set_ylabel("influence")
        axes.set_ylim(bottom=0.0)
        legend(axes, 2)

    return Drawing(draw, 2.8)
