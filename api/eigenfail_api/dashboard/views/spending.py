"""What a campaign cost, what that bought by when, and what the time went into."""

import msgspec

from eigenfail.values import CampaignCost, TimeSplit
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.charts import Chart, rounded
from eigenfail_api.dashboard.views.summaries import Figure

PARTS = {
    "Simulation": ("simulation_s", "episodes were with a worker"),
    "Learning": ("learning_s", "the learner worked, no episode was with a worker"),
    "Waiting": ("waiting_s", "for workers or for the database"),
    "Lost": ("lost_s", "results that were thrown away"),
}


class TimePart(msgspec.Struct, frozen=True, kw_only=True):
    """A part of the time that was billed.

    Attributes:
        percent: of that time, from 0 to 100.
    """

    name: str
    meaning: str
    percent: float
    share: str
    lasted: str


class SpendingView(msgspec.Struct, frozen=True, kw_only=True):
    """The part of a campaign's page about cost.

    Attributes:
        analysis: the one that the modes are of; None where they are of none.
        modes: how many there are and why, or why they are not known.
        parts: of the time; empty where it was not measured, or none has passed.
        problem: why the parts are missing; empty otherwise.
    """

    tiles: tuple[tuple[str, Figure], ...]
    analysis: int | None
    modes: str
    chart: Chart | None
    parts: tuple[TimePart, ...]
    active: str
    problem: str
    notes: tuple[str, ...]


def spending_view(found: CampaignCost) -> SpendingView:
    """Bill, curve and time."""
    return SpendingView(
        tiles=cost_tiles(found),
        analysis=found.analysis,
        modes=found.modes_in_words,
        chart=curve_chart(found) if len(found.curve) > 1 else None,
        parts=time_parts(found.time),
        active=formats.duration(found.time.active_s),
        problem=found.time.problem,
        notes=found.notes,
    )


def cost_tiles(found: CampaignCost) -> tuple[tuple[str, Figure], ...]:
    """What was spent, and the price of what it bought."""
    hours = f"{formats.number(found.cost.instance_hours)} instance-hours"
    price = f"at {formats.number(found.price_usd_per_hour)} USD/h × {found.instances}"
    return (
        ("Spent", Figure(f"{formats.number(found.cost.total_usd)} USD", (hours, price))),
        ("Per failure", per_failure(found)),
        ("Per distinct mode", per_mode(found)),
    )


def per_failure(found: CampaignCost) -> Figure:
    """With its interval, or the least that one costs."""
    bounds = found.cost.interval_usd
    basis = formats.counted(found.failures, "failure")
    notes = (basis, formats.interval(bounds)) if bounds else (basis, "95 % lower bound")
    return Figure(formats.cost_per_failure(found.cost), notes if found.completed else ())


def per_mode(found: CampaignCost) -> Figure:
    """Dashes where no modes are known."""
    if found.modes is None:
        return Figure(formats.NONE, ("no distinct modes are known",))
    price = formats.NONE if found.per_mode_usd is None else formats.number(found.per_mode_usd)
    return Figure(f"{price} USD", (formats.counted(found.modes, "distinct mode"),))


def curve_chart(found: CampaignCost) -> Chart:
    """Failures and modes by the money spent until then."""
    points, known = found.curve, found.modes is not None
    return Chart(
        id="spending-chart",
        kind="spending",
        title="Cost against what was found",
        caption=f"Failures{' and distinct modes' * known} found once so much was spent.",
        data={
            "usd": rounded(point.usd for point in points),
            "failures": [point.failures for point in points],
            "modes": [point.modes for point in points] if known else None,
        },
        columns=("USD", "Active [s]", "Episodes", "Failures", "Modes"),
        rows=tuple(
            (
                formats.number(point.usd),
                formats.number(point.active_s),
                formats.integer(point.completed),
                formats.integer(point.failures),
                formats.NONE if point.modes is None else str(point.modes),
            )
            for point in points
        ),
    )


def time_parts(time: TimeSplit) -> tuple[TimePart, ...]:
    """The four parts, as far as they were measured."""
    if time.simulation_s is None or time.active_s <= 0.0:
        return ()
    return tuple(
        time_part(name, meaning, getattr(time, field) or 0.0, time.active_s)
        for name, (field, meaning) in PARTS.items()
    )


def time_part(name: str, meaning: str, part_s: float, active_s: float) -> TimePart:
    """One of them."""
    share = part_s / active_s
    return TimePart(
        name=name,
        meaning=meaning,
        percent=round(100.0 * share, 2),
        share=f"{100.0 * share:.1f} %",
        lasted=formats.duration(part_s),
    )
