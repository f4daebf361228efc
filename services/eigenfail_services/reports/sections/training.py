"""Mean disturbances of the failures over the training (paper, figure of ten intervals)."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from eigenfail.values import AXES
from eigenfail.values.report import Cell, ReportPicture, ReportSection
from eigenfail_services.reports import formats
from eigenfail_services.reports.analysed import Analysed, analysed
from eigenfail_services.reports.material import Material
from eigenfail_services.reports.parts import Drawing, Part, table
from eigenfail_services.reports.pictures import INK, MUTED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TABLE = "training"
SPACE_SIGMA = 3.0
COLUMNS = (
    ("campaign", "Campaign"),
    ("interval", "Interval"),
    ("start", "From", "share"),
    ("end", "to", "share"),
    ("failures", "Failures"),
    ("step", "Step"),
    *((axis, f"Mean {axis} noise", "sigma") for axis in AXES),
)
WORDS = (
    "The mean noise of the failures in each tenth of a campaign's episodes, the first tenth at the "
    f"top. Lines stand {SPACE_SIGMA:g} sigma apart, each on its own zero. A method that learns "
    "settles on a pattern; one that does not learn shows chance."
)


def part(material: Material) -> Part | None:
    """The training of every campaign that was analysed."""
    found = [each for each in analysed(material) if each.result.training]
    if not found:
        return None
    rows = [row for each in found for row in steps(each)]
    section = ReportSection(
        name="training",
        title="Disturbances over the training",
        words=(WORDS,),
        tables=(table(TABLE, "Mean noise of the failures by interval", COLUMNS, rows),),
        pictures=tuple(map(picture, found)),
    )
    return Part(section, drawings={picture(each).name: drawing(each) for each in found})


def steps(found: Analysed) -> Iterator[tuple[Cell, ...]]:
    """A row for each step of each interval that has a failure."""
    for number, each in enumerate(found.result.training, start=1):
        who = (found.subject.id, number, each.start, each.end, each.failures)
        for step, z in enumerate(each.mean.astype(float) if each.failures else ()):
            yield (*who, step, *(float(value) for value in z))


def picture(found: Analysed) -> ReportPicture:
    """How the mean noise moved, in words."""
    told = (
        f"{formats.percent(each.start)} to {formats.percent(each.end)}: {each.failures} failures"
        for each in found.result.training
    )
    return ReportPicture(
        name=f"training-{found.name}",
        title=f"Disturbances over the training, campaign {found.subject.label}",
        alternative=f"Failures by interval: {'; '.join(told)}.",
        table=TABLE,
        campaigns=(found.subject.id,),
    )


def drawing(found: Analysed) -> Drawing:
    """A line for each interval, one below the other; a column for each axis."""

    def draw(figure: "Figure") -> None:
        columns = figure.subplots(1, 2, sharex=True, sharey=True)
        for way, (axes, axis) in enumerate(zip(columns, AXES, strict=True)):
            lines(axes, found, way)
            axes.set_title(f"{axis} noise")
            axes.set_xlabel("time [s]" if found.step_s else "step")
        intervals = found.result.training
        columns[0].set_yticks(
            [-SPACE_SIGMA * row for row in range(len(intervals))],
            [f"{100.0 * each.start:g}–{100.0 * each.end:g} %" for each in intervals],
        )
        columns[0].set_ylabel("episodes of the campaign")

    return Drawing(draw, 4.6)


def lines(axes: "Axes", found: Analysed, way: int) -> None:
    """The mean noise along one axis in each interval."""
    for row, each in enumerate(found.result.training):
        zero = -SPACE_SIGMA * row
        axes.axhline(zero, color=MUTED, linewidth=0.6, linestyle=(0, (1.2, 1.6)))
        if each.failures:
            at = np.arange(len(each.mean)) * (found.step_s or 1.0)
            axes.plot(at, zero + each.mean[:, way], color=INK, linewidth=1.2)
    axes.grid(visible=False, axis="y")
