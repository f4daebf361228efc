"""How much of the failures' variance each component explains (paper, explained variance)."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from eigenfail.values.report import Cell, ReportPicture, ReportSection
from eigenfail_services.reports import formats
from eigenfail_services.reports.analysed import Analysed, analysed
from eigenfail_services.reports.material import Material
from eigenfail_services.reports.parts import BESIDE, Drawing, Part, table
from eigenfail_services.reports.pictures import legend, mark
from eigenfail_services.reports.samples import in_groups

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLE = "explained-variance"
COLUMNS = (
    ("campaign", "Campaign"),
    ("component", "Component"),
    ("share", "Share of the variance", "share"),
    ("cumulative", "Cumulative", "share"),
)
WORDS = (
    "If a few components explain much of the variance, the failures are alike; bars are single "
    "components, lines their sum so far."
)


def part(material: Material) -> Part | None:
    """The explained variance of every campaign that was analysed."""
    found = [each for each in analysed(material) if len(each.result.explained)]
    if not found:
        return None
    named = dict(zip(names(len(found)), in_groups(found, BESIDE), strict=True))
    rows = [row for each in found for row in shares(each)]
    section = ReportSection(
        name="variance",
        title="Explained variance",
        words=(WORDS,),
        tables=(table(TABLE, "Variance explained by the components", COLUMNS, rows),),
        pictures=tuple(picture(name, tuple(group)) for name, group in named.items()),
    )
    return Part(section, drawings={name: drawing(tuple(of)) for name, of in named.items()})


def names(count: int) -> Iterator[str]:
    """A name for each picture."""
    yield TABLE
    yield from (f"{TABLE}-{number}" for number in range(2, -(-count // BESIDE) + 1))


def shares(found: Analysed) -> Iterator[tuple[Cell, ...]]:
    """A row for each component."""
    explained = found.result.explained.astype(float)
    for number, (share, so_far) in enumerate(zip(explained, np.cumsum(explained), strict=True), 1):
        yield (found.subject.id, number, float(share), float(so_far))


def picture(name: str, group: tuple[Analysed, ...]) -> ReportPicture:
    """The picture of these campaigns, in words."""
    told = (
        f"Campaign {each.subject.label}: the first component explains "
        f"{formats.percent(float(each.result.explained[0]))}, all {len(each.result.explained)} "
        f"together {formats.percent(float(each.result.explained.sum()))}."
        for each in group
    )
    return ReportPicture(
        name=name,
        title="Explained variance",
        alternative=" ".join(told),
        table=TABLE,
        campaigns=tuple(each.subject.id for each in group),
    )


def drawing(group: tuple[Analysed, ...]) -> Drawing:
    """Bars side by side, and their sums."""
    width = 0.8 / len(group)

    def draw(figure: "Figure") -> None:
        axes = figure.subplots()
        for place, each in enumerate(group):
            look, explained = mark(each.subject.place), 100.0 * each.result.explained.astype(float)
            at = np.arange(1, len(explained) + 1) + (place - (len(group) - 1) / 2.0) * width
            axes.bar(
                at,
                explained,
                0.9 * width,
                facecolor="white",
                edgecolor=look.colour,
                hatch=look.hatch,
                label=each.subject.label,
            )
            axes.plot(at, np.cumsum(explained), **look.style)
        axes.set_xticks(range(1, 1 + max(len(each.result.explained) for each in group)))
        axes.set_xlabel("component")
        axes.set_ylabel("share of the variance [%]")
        axes.set_ylim(0.0, 100.0)
        legend(axes)

    return Drawing(draw, 2.9 + 0.16 * len(group))
