"""How likely the failures are, and how bad (paper, figure of likelihood against severity)."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from eigenfail.values import FailurePoint
from eigenfail.values.assessment import IN_WORDS
from eigenfail.values.report import Cell, ReportPicture, ReportSection
from eigenfail_services.reports import formats
from eigenfail_services.reports.material import Material, Subject
from eigenfail_services.reports.parts import Drawing, Part, groups, table
from eigenfail_services.reports.pictures import legend, mark
from eigenfail_services.reports.samples import sample_note

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLE = "failures"
PICTURE = "likelihood-severity"
COLUMNS = (
    ("campaign", "Campaign"),
    ("episode", "Episode"),
    ("log_p_per_step", "log p per step", "nat"),
    ("severity", "Severity", "m²/s²"),
    ("conflict", "Class"),
)
WORDS = (
    "Each mark is one failure. Up are the severe ones, to the right the likely ones: those up and "
    "to the right matter most."
)
NONE_FOUND = "No failure has been found, so there is nothing to draw."


def part(material: Material) -> Part:
    """The failures of all campaigns."""
    failing = [subject for subject in material.subjects if subject.safety.scatter.points]
    rows = [row(each.id, point) for each in failing for point in each.safety.scatter.points]
    notes = " ".join(filter(None, map(left_out, failing)))
    section = ReportSection(
        name="likelihood",
        title="Likelihood and severity of failures",
        words=(WORDS, *correlations(failing)) if failing else (NONE_FOUND,),
        tables=(table(TABLE, "Failures", COLUMNS, rows, notes),),
        pictures=tuple(picture(name, group) for name, group in groups(failing, PICTURE)),
    )
    return Part(section, drawings={name: drawing(of) for name, of in groups(failing, PICTURE)})


def row(campaign: int, point: FailurePoint) -> tuple[Cell, ...]:
    """The numbers of a failure."""
    conflict = IN_WORDS[point.conflict] if point.conflict else None
    return (campaign, point.index, point.log_probability_per_step, point.severity, conflict)


def left_out(subject: Subject) -> str:
    """Whether all of its failures are there."""
    scatter = subject.safety.scatter
    note = sample_note(len(scatter.points), scatter.of, "failures")
    return f"Campaign {subject.id}: {note}" if note else ""


def correlations(failing: list[Subject]) -> Iterator[str]:
    """Whether the severe failures are the rarer ones."""
    for subject in failing:
        found, n = subject.safety.scatter.rank_correlation, len(subject.safety.scatter.points)
        if found is not None:
            bounds = f" [{formats.bounds(found.interval)}]" if found.interval else ""
            yield (
                f"Campaign {subject.id}: rank correlation of severity and log p per step (Spearman)"
                f" {formats.number(found.value)}{bounds}, n = {n:,}; below 0 the severe failures "
                "are the rarer ones."
            )


def picture(name: str, group: tuple[Subject, ...]) -> ReportPicture:
    """The picture of these campaigns, in words."""
    return ReportPicture(
        name=name,
        title="Likelihood and severity of failures",
        alternative=" ".join(map(told, group)),
        table=TABLE,
        campaigns=tuple(subject.id for subject in group),
        note=" ".join(filter(None, map(left_out, group))),
    )


def told(subject: Subject) -> str:
    """Where the failures of a campaign lie."""
    points = subject.safety.scatter.points
    likely = [point.log_probability_per_step for point in points]
    severe = [point.severity for point in points]
    return (
        f"Campaign {subject.label}: {len(points)} failures, log p per step from "
        f"{formats.number(min(likely))} to {formats.number(max(likely))}, severity from "
        f"{formats.number(min(severe))} to {formats.number(max(severe))} m²/s²."
    )


def drawing(group: tuple[Subject, ...]) -> Drawing:
    """A mark for each failure."""

    def draw(figure: "Figure") -> None:
        axes = figure.subplots()
        for subject in group:
            points = subject.safety.scatter.points
            axes.plot(
                [point.log_probability_per_step for point in points],
                [point.severity for point in points],
                linestyle="none",
                marker=mark(subject.place).marker,
                markerfacecolor="none",
                markeredgecolor=mark(subject.place).colour,
                markeredgewidth=0.9,
                label=subject.label,
            )
        axes.set_xlabel("log p per step [nat]")
        axes.set_ylabel("severity ‖Δv‖² [m²/s²]")
        axes.set_ylim(bottom=0.0)
        legend(axes)

    return Drawing(draw, 3.4 + 0.16 * len(group))
