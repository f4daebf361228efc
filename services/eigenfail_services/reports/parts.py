"""A section with what people see of it beside its numbers: worded tables, and drawings."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

from eigenfail.values.report import Cell, ReportColumn, ReportSection, ReportTable
from eigenfail_services.reports import formats
from eigenfail_services.reports.material import Subject
from eigenfail_services.reports.samples import in_groups

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BESIDE = 5
"""How many campaigns stand side by side; further ones begin a new table or picture."""

Draw = Callable[["Figure"], None]


class Drawing(NamedTuple):
    """What is drawn, on a figure of the usual width.

    Attributes:
        height_in: of the figure [inch].
    """

    draw: Draw
    height_in: float = 3.4


class Grid(NamedTuple):
    """A table in words; each cell a figure, and below it what it rests on."""

    header: tuple[str, ...]
    rows: tuple[tuple[formats.Lines, ...], ...]


class Part(NamedTuple):
    """A section, and how people see it.

    Attributes:
        grids: tables in words, by the name of the table that they word; a table without one is
            shown as it is.
        drawings: by the name of the picture.
        folded: tables that a reader has to open first.
    """

    section: ReportSection
    grids: Mapping[str, tuple[Grid, ...]] = {}
    drawings: Mapping[str, Drawing] = {}
    folded: frozenset[str] = frozenset()


def table(
    name: str,
    title: str,
    columns: Sequence[tuple[str, ...]],
    rows: Sequence[tuple[Cell, ...]],
    note: str = "",
) -> ReportTable:
    """A table of columns given as (name, title, unit), the unit left out where there is none."""
    made = tuple(ReportColumn(*column) for column in columns)
    return ReportTable(name=name, title=title, columns=made, rows=tuple(rows), note=note)


def side_by_side(
    subjects: Sequence[Subject], figures: Mapping[str, Callable[[Subject], formats.Lines]]
) -> tuple[Grid, ...]:
    """A row for each figure, a column for each campaign."""
    return tuple(
        Grid(
            header=("", *(each.label for each in group)),
            rows=tuple(
                ((title,), *(figure(each) for each in group)) for title, figure in figures.items()
            ),
        )
        for group in in_groups(subjects, BESIDE)
    )


def by_name(
    subjects: Sequence[Subject], told: Mapping[int, Mapping[str, formats.Lines]]
) -> tuple[Grid, ...]:
    """The same, of figures that are there: for each campaign by its id, then by name."""

    def value_of(name: str) -> Callable[[Subject], formats.Lines]:
        return lambda subject: told[subject.id].get(name, (formats.NONE,))

    names = dict.fromkeys(name for of in told.values() for name in of)
    return side_by_side(subjects, {name: value_of(name) for name in names})


def groups(subjects: Sequence[Subject], name: str) -> Iterator[tuple[str, tuple[Subject, ...]]]:
    """The campaigns that share a picture, and its name."""
    for number, group in enumerate(in_groups(subjects, BESIDE), start=1):
        yield (name if number == 1 else f"{name}-{number}"), tuple(group)
