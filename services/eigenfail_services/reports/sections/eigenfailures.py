"""Eigenfailures with the noise of the failures that they stand for (paper, inverse transform)."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from eigenfail.values import AXES, Floats
from eigenfail.values.report import Cell, ReportPicture, ReportSection
from eigenfail_services.reports import formats
from eigenfail_services.reports.analysed import MOST_MODES, Analysed, Band, analysed, band
from eigenfail_services.reports.material import Material
from eigenfail_services.reports.parts import Drawing, Part, table
from eigenfail_services.reports.pictures import MUTED, mark
from eigenfail_services.reports.samples import sample_note

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TABLE = "eigenfailures"
COLUMNS = (
    ("campaign", "Campaign"),
    ("mode", "Mode"),
    ("step", "Step"),
    ("time_s", "Time", "s"),
    ("members", "Members at this step"),
    *(
        (f"{kind}_{axis}", f"{title}, {axis}", "sigma")
        for axis in AXES
        for kind, title in (
            ("eigenfailure", "Eigenfailure"),
            ("mean", "Mean of the members"),
            ("deviation", "Standard deviation"),
        )
    ),
)
WORDS = (
    "The line is the eigenfailure, ready to be injected; the hatched band is the mean of the "
    "mode's members ± their standard deviation, at the steps that they reached. Where the band is "
    "narrower than ± 1 the failures agree on more than the disturbance model does."
)

Bands = tuple[Band, ...]


def part(material: Material) -> Part | None:
    """The eigenfailures of every campaign that was analysed."""
    found = [*analysed(material)]
    if not found:
        return None
    bands = [bands_of(material, each) for each in found]
    each_with = [*zip(found, bands, strict=True)]
    rows = [row for each, of in each_with for row in steps(each, of)]
    section = ReportSection(
        name="eigenfailures",
        title="Eigenfailures",
        words=(WORDS,),
        tables=(table(TABLE, "Eigenfailures over time", COLUMNS, rows),),
        pictures=tuple(picture(each, of) for each, of in each_with),
    )
    drawings = {f"eigenfailures-{each.name}": drawing(each, of) for each, of in each_with}
    return Part(section, drawings=drawings)


def bands_of(material: Material, found: Analysed) -> Bands:
    """The band of each mode."""
    return tuple(band(material.store, found, mode) for mode in range(len(found.result.modes)))


def steps(found: Analysed, bands: Bands) -> Iterator[tuple[Cell, ...]]:
    """A row for each step of each mode."""
    for number, (mode, of) in enumerate(zip(found.result.modes, bands, strict=True), start=1):
        for step, z in enumerate(mode.eigenfailure.astype(float)):
            at_s = step * found.step_s if found.step_s else None
            figures = np.stack([z, of.mean[step], of.deviation[step]], axis=1).ravel()
            told = (float(value) if np.isfinite(value) else None for value in figures)
            yield (found.subject.id, number, step, at_s, int(of.reached[step]), *told)


def picture(found: Analysed, bands: Bands) -> ReportPicture:
    """The eigenfailures of a campaign, in words."""
    told = (
        f"mode {number}: {peak(found, mode.eigenfailure)}"
        for number, mode in enumerate(found.result.modes[:MOST_MODES], start=1)
    )
    of = sum(each.of for each in bands)
    notes = (found.modes_note, sample_note(sum(each.shown for each in bands), of, "members"))
    return ReportPicture(
        name=f"eigenfailures-{found.name}",
        title=f"Eigenfailures, campaign {found.subject.label}",
        alternative=f"{'; '.join(told)}.".capitalize(),
        table=TABLE,
        campaigns=(found.subject.id,),
        note=" ".join(filter(None, notes)),
    )


def peak(found: Analysed, z: Floats) -> str:
    """The largest disturbance along each axis, in words."""
    largest = ((axis, int(np.argmax(np.abs(z[:, way]))), way) for way, axis in enumerate(AXES))
    return ", ".join(
        f"{axis} {formats.number(float(z[step, way]))} sigma at {moment(found, step)}"
        for axis, step, way in largest
    )


def moment(found: Analysed, step: int) -> str:
    """When a step is, in words."""
    return f"{formats.number(step * found.step_s)} s" if found.step_s else f"step {step}"


def drawing(found: Analysed, bands: Bands) -> Drawing:
    """A row for each mode, a column for each axis."""
    modes = found.result.modes[:MOST_MODES]

    def draw(figure: "Figure") -> None:
        grid = figure.subplots(len(modes), 2, sharex=True, sharey=True, squeeze=False)
        for number, row in enumerate(grid):
            for way, axis in enumerate(AXES):
                one(row[way], found, bands[number], number, way)
                row[way].set_title(f"mode {number + 1}, {axis}")
            row[0].set_ylabel("noise [sigma]")
        for axes in grid[-1]:
            axes.set_xlabel("time [s]" if found.step_s else "step")

    return Drawing(draw, 0.6 + 1.7 * len(modes))


def one(axes: "Axes", found: Analysed, of: Band, mode: int, way: int) -> None:
    """One mode along one axis."""
    z = found.result.modes[mode].eigenfailure[:, way]
    at = np.arange(len(z)) * (found.step_s or 1.0)
    low, high = of.mean[:, way] - of.deviation[:, way], of.mean[:, way] + of.deviation[:, way]
    axes.fill_between(at, low, high, facecolor="none", edgecolor=MUTED, hatch="////", linewidth=0.0)
    for edge in (low, high):
        axes.plot(at, edge, color=MUTED, linewidth=0.8, linestyle=(0, (1.2, 1.6)))
    axes.axhline(0.0, color=MUTED, linewidth=0.8)
    axes.plot(at, z, color=mark(mode).colour, linewidth=1.8)
