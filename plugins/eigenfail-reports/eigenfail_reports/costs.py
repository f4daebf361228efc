"""Costs and minimal failures."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

from eigenfail.errors import Conflict
from eigenfail.presentation import figures, svg
from eigenfail.presentation.analyses import choose_channel_words
from eigenfail.presentation.tables import format_cost
from eigenfail.values.analysis import MinimalFailure
from eigenfail.values.summary import CampaignCost, CostPoint
from eigenfail.worlds import list_channels
from eigenfail_reports import page
from eigenfail_reports.contents import Cell, ReportPicture
from eigenfail_reports.material import Material, Subject
from eigenfail_services.campaigns.costs import find_spending
from eigenfail_services.campaigns.minimal_failures import METHOD, find_minimal_failure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


COST, CURVE = "cost", "cost-curve"


CURVE_COLUMNS = (
    ("campaign", "Campaign"),
    ("cost", "Cost so far", "USD"),
    ("active_s", "Time running", "s"),
    ("episodes", "Episodes"),
    ("failures", "Failures so far"),
    ("modes", "Distinct modes so far"),
)


COST_WORDS = (
    "Failures found against what the computing had cost by then: the steeper, the cheaper a "
    "failure. This is the price of searching, not a valuation of collisions. Time is split into "
    "simulation, learning while no episode ran, waiting for workers or the database, and what was "
    "lost with results that could not be kept."
)


class Spent(NamedTuple):
    """A campaign with its cost."""

    subject: Subject
    found: CampaignCost


COST_COLUMNS: tuple[page.ColumnOf[CampaignCost], ...] = (
    ("campaign", "Campaign", "", lambda found: found.campaign),
    ("price", "Price of an instance-hour", "USD", lambda found: found.price_usd_per_hour),
    ("instances", "Instances", "", lambda found: found.instances),
    ("cost", "Cost", "USD", lambda found: found.cost.total_usd),
    ("failures", "Failures", "", lambda found: found.failures),
    ("modes", "Distinct modes", "", lambda found: found.modes),
    ("cost_per_mode", "Cost per distinct mode", "USD", lambda found: found.per_mode_usd),
    ("active_s", "Time running", "s", lambda found: found.time.active_s),
    ("simulation_s", "Simulation", "s", lambda found: found.time.simulation_s),
    ("startup_s", "Start-up", "s", lambda found: found.time.startup_s),
    ("learning_s", "Learning", "s", lambda found: found.time.learning_s),
    ("waiting_s", "Waiting", "s", lambda found: found.time.waiting_s),
    ("lost_s", "Lost", "s", lambda found: found.time.lost_s),
)


def make_cost(material: Material) -> page.ReportPart:
    """The cost of all campaigns."""
    store = material.store
    spent = [Spent(each, find_spending(store, each.campaign)) for each in material.subjects]
    begun = [each for each in spent if each.found.curve]
    return page.ReportPart(
        name="cost",
        title="Cost",
        words=(COST_WORDS, *dict.fromkeys(note for each in spent for note in list_notes(each))),
        tables=(
            page.tabulate(
                COST, "Cost of the campaigns", COST_COLUMNS, [each.found for each in spent]
            ),
            page.make_table(CURVE, "Failures over cost", CURVE_COLUMNS, [*list_curve_rows(spent)]),
        ),
        pictures=tuple(
            (describe_cost_picture(name, group), draw_cost(group))
            for name, group in page.name_groups(begun, CURVE)
        ),
        grids={
            COST: page.make_named_grids(
                material.subjects, {s.id: dict(list_figures(of)) for s, of in spent}
            )
        },
    )


def list_notes(spent: Spent) -> Iterator[str]:
    """Return the remarks on approximate and missing figures."""
    yield from (f"Cost curve: {note}" for note in spent.found.notes)


def list_curve_rows(spent: list[Spent]) -> Iterator[tuple[Cell, ...]]:
    """Yield the rows of the cost curves."""
    for each in spent:
        for at in each.found.curve:
            yield (each.subject.id, at.usd, at.active_s, at.completed, at.failures, at.modes)


def list_figures(found: CampaignCost) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield the names and values of a campaign's costs."""
    price, time = figures.format_money(found.price_usd_per_hour), found.time
    hours = f"{figures.format_number(found.cost.instance_hours)} instance-hours"
    yield "Cost", (figures.format_money(found.cost.total_usd), f"{hours} at {price}")
    yield "Cost per failure", format_cost(found.cost).lines
    modes = (
        "modes are not known"
        if found.modes is None
        else figures.count_noun(found.modes, "distinct mode")
    )
    yield "Cost per distinct mode", (figures.format_money(found.per_mode_usd), modes)
    yield "Time running", (format_seconds(time.active_s),)
    yield "Simulation", format_cost_share(time.simulation_s, time.active_s)
    yield "Start-up", format_cost_share(time.startup_s, time.active_s)
    yield "Learning", format_cost_share(time.learning_s, time.active_s)
    yield "Waiting", format_cost_share(time.waiting_s, time.active_s)
    yield "Lost", format_cost_share(time.lost_s, time.active_s)


def format_seconds(value: float | None) -> str:
    """Return a duration as text."""
    return figures.UNKNOWN if value is None else f"{figures.format_number(value)} s"


def format_cost_share(value: float | None, of: float) -> tuple[str, ...]:
    """A part of the time."""
    if value is None or not of:
        return (format_seconds(value),)
    return (format_seconds(value), figures.format_share(value / of))


def describe_cost_picture(name: str, group: Sequence[Spent]) -> ReportPicture:
    """Return the description of the cost picture of some campaigns."""
    sentences = (
        f"Campaign {each.subject.label}: {last.failures} failures for "
        f"{figures.format_money(last.usd)}."
        for each in group
        for last in each.found.curve[-1:]
    )
    return ReportPicture(
        name=name,
        title="Failures found over cost",
        alternative=" ".join(sentences),
        table=CURVE,
        campaigns=tuple(each.subject.id for each in group),
    )


def draw_cost(group: Sequence[Spent]) -> svg.Drawing:
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
                **svg.pick_mark(subject.place).style,
            )
        axes.set_xlabel("cost so far [USD]")
        axes.set_ylabel("failures found")
        axes.set_xlim(left=0.0)
        page.draw_legend(axes)

    return svg.Drawing(draw, 3.0 + 0.16 * len(group))


MINIMAL_WORDS = "A failing noise trajectory reduced to the noise that is necessary for the failure."


def make_minimal(material: Material) -> page.ReportPart | None:
    """The minimal failures that campaigns came to."""
    found = [*find_minimal_failures(material)]
    if not found:
        return None
    called = choose_channel_words(list_shrunk_channels(material))
    columns: tuple[page.ColumnOf[MinimalFailure], ...] = (
        ("campaign", "Campaign", "", lambda each: each.campaign),
        ("episode", "Episode", "", lambda each: each.index),
        ("done", "Search at its end", "", lambda each: each.done),
        ("needed", f"Steps and {called.several} needed", "", lambda each: each.needed),
        ("injected", "of", "", lambda each: each.injected),
        ("energy", "Energy", "sigma²", lambda each: each.energy),
        ("full_energy", "of", "sigma²", lambda each: each.full_energy),
        ("log_p_per_step", "log p per step", "nat", lambda each: each.log_probability_per_step),
        (
            "full_log_p_per_step",
            "at full strength",
            "nat",
            lambda each: each.full_log_probability_per_step,
        ),
    )
    counted = f"Each step along one {called.one} counts as one; energy is the sum of z²."
    sentences = (f"Campaign {each.campaign}: {each.words} {each.because}" for each in found)
    return page.ReportPart(
        name="minimal",
        title="Minimal failures",
        words=(f"{MINIMAL_WORDS} {counted}", *sentences),
        tables=(page.tabulate("minimal", "Minimal failures", columns, found),),
    )


def list_shrunk_channels(material: Material) -> tuple[str, ...]:
    """Return the channels of the campaigns that shrink failures, each once."""
    specs = [subject.campaign.spec for subject in material.subjects]
    return tuple(
        dict.fromkeys(
            channel for spec in specs if spec.method == METHOD for channel in list_channels(spec)
        )
    )


def find_minimal_failures(material: Material) -> Iterator[MinimalFailure]:
    """Yield the minimal failures of the campaigns that shrink failures."""
    for subject in material.subjects:
        if subject.campaign.spec.method == METHOD:
            try:
                yield find_minimal_failure(material.store, subject.campaign)
            except Conflict:
                continue
