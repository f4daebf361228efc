"""How failures came over the episodes: the learning curve of a method that learns."""

from typing import TYPE_CHECKING

from eigenfail.values import CourseBlock
from eigenfail.values.report import Cell, ReportPicture, ReportSection
from eigenfail_services.reports import formats
from eigenfail_services.reports.material import Material, Subject
from eigenfail_services.reports.parts import Drawing, Part, groups, table
from eigenfail_services.reports.pictures import legend, mark

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLE = "learning-curve"
COLUMNS = (
    ("campaign", "Campaign"),
    ("first", "First episode"),
    ("last", "Last episode"),
    ("n", "Episodes completed"),
    ("failures", "Failures"),
    ("failure_rate", "Failure rate", "share"),
    ("failure_rate_low", "from", "share"),
    ("failure_rate_high", "to", "share"),
    ("log_p_per_step", "log p per step of the failures", "nat"),
    ("smallest_robustness_m", "Smallest robustness", "m"),
    ("median_robustness_m", "Median robustness", "m"),
)
WORDS = (
    "Failure rate by blocks of neighbouring episodes, with 95 % intervals, and log p per step of "
    "the failures in each block. Only a method that learns has a learning curve: with the others "
    "a change over the episodes is chance."
)


def part(material: Material) -> Part:
    """The courses of the campaigns."""
    begun = [subject for subject in material.subjects if subject.course.blocks]
    rows = [row(subject, block) for subject in begun for block in subject.course.blocks]
    pictures = tuple(picture(name, group) for name, group in groups(begun, TABLE))
    section = ReportSection(
        name="learning",
        title="Learning curve",
        words=(WORDS,) if begun else ("No episode has ended yet.",),
        tables=(table(TABLE, "Failures over episodes", COLUMNS, rows),),
        pictures=pictures,
    )
    drawings = {name: drawing(group) for name, group in groups(begun, TABLE)}
    return Part(section, drawings=drawings)


def row(subject: Subject, block: CourseBlock) -> tuple[Cell, ...]:
    """The numbers of a block."""
    rate = block.failure_rate
    return (
        *(subject.id, block.first, block.last, rate.n, rate.k),
        *(rate.value, rate.interval.low, rate.interval.high),
        *(block.log_probability_per_step, block.smallest_robustness_m, block.median_robustness_m),
    )


def picture(name: str, group: tuple[Subject, ...]) -> ReportPicture:
    """The picture of these campaigns, in words."""
    return ReportPicture(
        name=name,
        title="Failure rate and likelihood of failures over episodes",
        alternative=" ".join(map(told, group)),
        table=TABLE,
        campaigns=tuple(subject.id for subject in group),
    )


def told(subject: Subject) -> str:
    """How the failure rate of a campaign moved."""
    first, last = subject.course.blocks[0].failure_rate, subject.course.blocks[-1].failure_rate
    return (
        f"Campaign {subject.label}: failure rate {formats.percent(first.value)} in the first block "
        f"of up to {subject.course.per} episodes, {formats.percent(last.value)} in the last."
    )


def drawing(group: tuple[Subject, ...]) -> Drawing:
    """Failure rate above, likelihood below."""

    def draw(figure: "Figure") -> None:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        for subject in group:
            look, blocks = mark(subject.place), subject.course.blocks
            middle = [(block.first + block.last) / 2.0 for block in blocks]
            rates = [block.failure_rate for block in blocks]
            down = [100.0 * (rate.value - rate.interval.low) for rate in rates]
            up = [100.0 * (rate.interval.high - rate.value) for rate in rates]
            above.errorbar(
                middle,
                [100.0 * rate.value for rate in rates],
                yerr=[[max(each, 0.0) for each in down], [max(each, 0.0) for each in up]],
                capsize=2.0,
                elinewidth=0.8,
                label=subject.label,
                **look.style,
            )
            likely = [block.log_probability_per_step for block in blocks]
            known = [(at, value) for at, value in zip(middle, likely, strict=True) if value]
            if known:
                below.plot(*zip(*known, strict=True), **look.style)
        above.set_ylabel("failure rate [%]")
        below.set_ylabel("log p per step [nat]")
        below.set_xlabel("episode")
        legend(above)

    return Drawing(draw, 4.0 + 0.16 * len(group))
