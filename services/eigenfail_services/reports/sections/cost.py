"""What failures and modes cost to find, and what the time went into."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

from eigenfail.values import CampaignCost, CostPoint
from eigenfail.values.report import Cell, ReportPicture, ReportSection
from eigenfail_services.campaigns.spending import spending_of
from eigenfail_services.reports import formats
from eigenfail_services.reports.material import Material, Subject
from eigenfail_services.reports.parts import Drawing, Part, by_name, groups, table
from eigenfail_services.reports.pictures import legend, mark

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COST, CURVE = "cost", "cost-curve"
COST_COLUMNS = (
    ("campaign", "Campaign"),
    ("price", "Price of an instance-hour", "USD"),
    ("instances", "Instances"),
    ("cost", "Cost", "USD"),
    ("failures", "Failures"),
    ("modes", "Distinct modes"),
    ("cost_per_mode", "Cost per distinct mode", "USD"),
    ("active_s", "Time running", "s"),
    ("simulation_s", "Simulation", "s"),
    ("learning_s", "Learning", "s"),
    ("waiting_s", "Waiting", "s"),
    ("lost_s", "Lost", "s"),
)
CURVE_COLUMNS = (
    ("campaign", "Campaign"),
    ("cost", "Cost so far", "USD"),
    ("active_s", "Time running", "s"),
    ("episodes", "Episodes"),
    ("failures", "Failures so far"),
    ("modes", "Distinct modes so far"),
)
WORDS = (
    "Failures found against what the computing had cost by then: the steeper, the cheaper a "
    "failure. This is the price of searching, not a valuation of collisions. Time is split into "
    "simulation, learning while no episode ran, waiting for workers or the database, and what was "
    "lost with results that could not be kept."
)


class Spent(NamedTuple):
    """A campaign, and what it cost."""

    subject: Subject
    found: CampaignCost


def part(material: Material) -> Part:
    """The cost of all campaigns."""
    store = material.store
    spent = [Spent(each, spending_of(store, each.campaign)) for each in material.subjects]
    begun = {each.subject.id: each for each in spent if each.found.curve}
    drawn = [*groups([each.subject for each in begun.values()], CURVE)]
    pictures = {name: [begun[subject.id] for subject in group] for name, group in drawn}
    section = ReportSection(
        name="cost",
        title="Cost",
        words=(WORDS, *dict.fromkeys(note for each in spent for note in notes(each))),
        tables=(
            table(COST, "Cost of the campaigns", COST_COLUMNS, [*map(row, spent)]),
            table(CURVE, "Failures over cost", CURVE_COLUMNS, [*points(spent)]),
        ),
        pictures=tuple(picture(name, group) for name, group in pictures.items()),
    )
    return Part(
        section,
        {COST: by_name(material.subjects, {s.id: dict(figures(of)) for s, of in spent})},
        {name: drawing(group) for name, group in pictures.items()},
    )


def notes(spent: Spent) -> Iterator[str]:
    """What is approximate or missing."""
    who = f"Campaign {spent.subject.id}"
    if spent.found.time.problem and spent.found.completed:
        yield f"{who}: {spent.found.time.problem}"
    yield from (f"Cost curve: {note}" for note in spent.found.notes)


def row(spent: Spent) -> tuple[Cell, ...]:
    """The numbers of a campaign."""
    found, time = spent.found, spent.found.time
    return (
        *(found.campaign, found.price_usd_per_hour, found.instances, found.cost.total_usd),
        *(found.failures, found.modes, found.per_mode_usd, time.active_s),
        *(time.simulation_s, time.learning_s, time.waiting_s, time.lost_s),
    )


def points(spent: list[Spent]) -> Iterator[tuple[Cell, ...]]:
    """The numbers of the curves."""
    for each in spent:
        for at in each.found.curve:
            yield (each.subject.id, at.usd, at.active_s, at.completed, at.failures, at.modes)


def figures(found: CampaignCost) -> Iterator[tuple[str, formats.Lines]]:
    """What people read of a campaign's cost."""
    price, time = formats.usd(found.price_usd_per_hour), found.time
    hours = f"{formats.number(found.cost.instance_hours)} instance-hours"
    yield "Cost", (formats.usd(found.cost.total_usd), f"{hours} at {price}")
    yield "Cost per failure", formats.cost_per_failure(found.cost)
    yield "Cost per distinct mode", (formats.usd(found.per_mode_usd), modes(found))
    yield "Time running", (seconds(time.active_s),)
    yield "Simulation", share(time.simulation_s, time.active_s)
    yield "Learning", share(time.learning_s, time.active_s)
    yield "Waiting", share(time.waiting_s, time.active_s)
    yield "Lost", share(time.lost_s, time.active_s)


def modes(found: CampaignCost) -> str:
    """How many distinct modes there are, or that they are not known."""
    return "modes are not known" if found.modes is None else f"{found.modes} distinct modes"


def seconds(value: float | None) -> str:
    """A time."""
    return formats.NONE if value is None else f"{formats.number(value)} s"


def share(value: float | None, of: float) -> formats.Lines:
    """A part of the time."""
    if value is None or not of:
        return (seconds(value),)
    return (seconds(value), formats.percent(value / of))


def picture(name: str, group: list[Spent]) -> ReportPicture:
    """The picture of these campaigns, in words."""
    told = (
        f"Campaign {each.subject.label}: {last.failures} failures for {formats.usd(last.usd)}."
        for each in group
        for last in each.found.curve[-1:]
    )
    return ReportPicture(
        name=name,
        title="Failures found over cost",
        alternative=" ".join(told),
        table=CURVE,
        campaigns=tuple(each.subject.id for each in group),
    )


def drawing(group: list[Spent]) -> Drawing:
    """A line for each campaign, with a mark at every tenth point or so."""

    def draw(figure: "Figure") -> None:
        axes = figure.subplots()
        for subject, found in group:
            curve: tuple[CostPoint, ...] = found.curve
            axes.plot(
                [at.usd for at in curve],
                [at.failures for at in curve],
                label=subject.label,
                markevery=max(1, len(curve) // 10),
                **mark(subject.place).style,
            )
        axes.set_xlabel("cost so far [USD]")
        axes.set_ylabel("failures found")
        axes.set_xlim(left=0.0)
        legend(axes)

    return Drawing(draw, 3.0 + 0.16 * len(group))
