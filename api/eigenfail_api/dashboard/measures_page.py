"""Safety, cost and workers of a campaign: a part of its page that takes longer to compute."""

import msgspec
from fastapi import APIRouter
from fastapi.responses import HTMLResponse

from eigenfail.presentation import campaigns
from eigenfail.presentation.figures import (
    UNKNOWN,
    count_noun,
    format_count,
    format_duration,
    format_number,
    format_share,
    format_usd,
)
from eigenfail.presentation.tables import FormattedCell, Table, format_cost
from eigenfail.values import FINAL_STATES, Campaign, CampaignCost, Safety, TimeSplit
from eigenfail.values.records import IN_WORDS
from eigenfail.values.safety import FailurePoint, Scatter
from eigenfail.worlds import world_of
from eigenfail_api.dashboard.charts import MOST_ROWS, Chart, round_values
from eigenfail_api.dashboard.overview_page import MOST_LINES
from eigenfail_api.dashboard.rendering import Tile, page, write_time
from eigenfail_api.parameters import CampaignId, Stored
from eigenfail_api.routes.analyses import COSTS
from eigenfail_services.campaigns.costs import CampaignFigures, find_figures
from eigenfail_services.campaigns.resolution import list_drawn

NOT_CLASSIFIED = "not classified"
COLLISION = "collision, "


class SafetyView(msgspec.Struct, frozen=True, kw_only=True):
    """The part of a campaign's page about safety.

    Attributes:
        severity: mean, VaR and CVaR of the failures.
        remarks: why one of these, or an interval, is missing, and what the numbers cannot know.
    """

    table: Table
    severity: tuple[tuple[str, FormattedCell], ...]
    remarks: tuple[str, ...]


def make_safety_view(found: Safety) -> SafetyView:
    """Return the view of the safety measures: table, severity and notes."""
    remarks = (found.severity.problem, *found.notes)
    return SafetyView(
        table=campaigns.tabulate_safety_measures(found),
        severity=campaigns.list_severity(found) if found.severity.n else (),
        remarks=tuple(filter(None, remarks)),
    )


def make_scatter_chart(scatter: Scatter) -> Chart:
    """Return the chart of the failures' likelihood and severity."""
    points = scatter.points
    return Chart(
        id="likelihood-chart",
        kind="likelihood",
        title="Likelihood and severity of failures",
        caption=(
            "Each failure: log-probability of its noise per step, and severity [m²/s²]. Up and to "
            f"the right are the likely and severe ones. {describe_coverage(scatter)}"
        ),
        data={
            "index": [point.index for point in points],
            "likelihood": round_values(point.log_probability_per_step for point in points),
            "severity": round_values(point.severity for point in points),
            "kind": [describe_kind(point) for point in points],
        },
        columns=("Episode", "log p per step", "Severity [m²/s²]", "Class"),
        rows=tuple(map(make_point_row, points[:MOST_ROWS])),
        note=f"The first {MOST_ROWS}." if len(points) > MOST_ROWS else "",
    )


def make_point_row(point: FailurePoint) -> tuple[str, ...]:
    """Return the row of a failure."""
    figures = (point.log_probability_per_step, point.severity)
    return (str(point.index), *map(format_number, figures), describe_kind(point))


def describe_kind(point: FailurePoint) -> str:
    """Return the class of a collision: unavoidable, planner failure, or not classified."""
    words = IN_WORDS[point.conflict] if point.conflict else NOT_CLASSIFIED
    return words.removeprefix(COLLISION)


def describe_coverage(scatter: Scatter) -> str:
    """Return how many of the failures are drawn."""
    if len(scatter.points) >= scatter.of:
        return ""
    return f"{format_count(len(scatter.points))} of {format_count(scatter.of)}."


PARTS = {
    "Simulation": ("simulation_s", "simulating on a worker"),
    "Start-up": ("startup_s", "learner starting or proposing, no episode on a worker"),
    "Learning": ("learning_s", "learner busy, no episode on a worker"),
    "Waiting": ("waiting_s", "for workers or for the database"),
    "Lost": ("lost_s", "discarded results"),
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
        parts: parts of the time; empty while none has passed.
    """

    tiles: tuple[tuple[str, Tile], ...]
    analysis: int | None
    modes: str
    chart: Chart | None
    parts: tuple[TimePart, ...]
    active: str
    notes: tuple[str, ...]


def make_spending_view(found: CampaignCost) -> SpendingView:
    """Return the view of the spending: bill, curve and time."""
    return SpendingView(
        tiles=make_cost_tiles(found),
        analysis=found.analysis,
        modes=found.modes_in_words,
        chart=make_curve_chart(found) if len(found.curve) > 1 else None,
        parts=time_parts(found.time),
        active=format_duration(found.time.active_s),
        notes=found.notes,
    )


def make_cost_tiles(found: CampaignCost) -> tuple[tuple[str, Tile], ...]:
    """Return the tiles of total cost and of cost per failure."""
    hours = f"{format_number(found.cost.instance_hours)} instance-hours"
    price = f"at {format_usd(found.price_usd_per_hour)} USD/h × {found.instances}"
    return (
        ("Spent", Tile(f"{format_usd(found.cost.total_usd)} USD", (hours, price))),
        ("Per failure", make_failure_cost_tile(found)),
        ("Per distinct mode", make_mode_cost_tile(found)),
    )


def make_failure_cost_tile(found: CampaignCost) -> Tile:
    """Return the tile of the cost per failure, with its interval or lower bound."""
    price, basis = format_cost(found.cost), count_noun(found.failures, "failure")
    return Tile(price.value, (basis, *price.notes) if found.completed else ())


def make_mode_cost_tile(found: CampaignCost) -> Tile:
    """Return the tile of the cost per mode; dashes where no modes are known."""
    if found.modes is None:
        return Tile(UNKNOWN, ("no distinct modes found",))
    return Tile(
        f"{format_usd(found.per_mode_usd)} USD", (count_noun(found.modes, "distinct mode"),)
    )


def make_curve_chart(found: CampaignCost) -> Chart:
    """Return the chart of failures and modes over the money spent."""
    points, known = found.curve, found.modes is not None
    return Chart(
        id="spending-chart",
        kind="spending",
        title="Failures and modes found against cost",
        caption=f"Failures{' and distinct modes' * known} found by amount spent.",
        data={
            "usd": round_values(point.usd for point in points),
            "failures": [point.failures for point in points],
            "modes": [point.modes for point in points] if known else None,
        },
        columns=("USD", "Active [s]", "Episodes", "Failures", "Modes"),
        rows=tuple(
            (
                format_usd(point.usd),
                format_number(point.active_s),
                format_count(point.completed),
                format_count(point.failures),
                UNKNOWN if point.modes is None else str(point.modes),
            )
            for point in points
        ),
    )


def time_parts(time: TimeSplit) -> tuple[TimePart, ...]:
    """The four parts; none while no time has passed."""
    if time.active_s <= 0.0:
        return ()
    return tuple(
        time_part(name, meaning, getattr(time, field), time.active_s)
        for name, (field, meaning) in PARTS.items()
    )


def time_part(name: str, meaning: str, part_s: float, active_s: float) -> TimePart:
    """One of them."""
    share = part_s / active_s
    return TimePart(
        name=name,
        meaning=meaning,
        percent=round(100.0 * share, 2),
        share=format_share(share),
        lasted=format_duration(part_s),
    )


class MeasuresView(msgspec.Struct, frozen=True, kw_only=True):
    """A part of the campaign's page, and a page by itself.

    Attributes:
        basis: number of episodes it covers, or why it has no values.
        safety: None before the first episode, and where nothing drives.
        scatter: None without a failure of known severity.
        cost: None before the first episode.
        varies: whether scenario parameters are drawn, so that there may be a failing region.
        workers: without rows before the first result.
    """

    campaign: int
    campaign_name: str
    basis: str
    safety: SafetyView | None
    scatter: Chart | None
    cost: SpendingView | None
    varies: bool
    workers: Table


def make_measures_view(
    campaign: Campaign, safety: Safety, cost: CampaignCost, workers: Table
) -> MeasuresView:
    """Return the whole page, without parts that have no values."""
    some = safety.completed > 0
    return MeasuresView(
        campaign=campaign.id,
        campaign_name=campaign.spec.name,
        basis=describe_basis(campaign, safety.completed, cost.completed),
        safety=make_safety_view(safety)
        if some and world_of(campaign.spec.simulator).has_road
        else None,
        scatter=make_scatter_chart(safety.scatter) if safety.scatter.points else None,
        cost=make_spending_view(cost) if some else None,
        varies=some and bool(list_drawn(campaign.spec)),
        workers=workers,
    )


def describe_basis(campaign: Campaign, completed: int, billed: int) -> str:
    """Return the number of episodes behind the figures; the page's others may have more."""
    is_open = campaign.state not in FINAL_STATES
    if not completed and is_open:
        return "Safety measures and cost appear after the first episode."
    if not completed:
        return "No episode was completed: there are no safety measures, and no failure has a price."
    if is_open:
        so_many = count_noun(completed, "completed episode")
        further = f"; cost as of {format_count(billed)}" if billed != completed else ""
        return f"As of {so_many}{further}; updated less often than the figures above."
    return f"Over all completed episodes: {format_count(completed)}."


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)


@router.get("/campaigns/{campaign}/measures", dependencies=[COSTS])
def show_measures(store: Stored, campaign: CampaignId) -> HTMLResponse:
    """Safety, cost and workers of a campaign: its page asks for them once it stands."""
    seen = store.campaigns.get(campaign)
    with store.figures.as_of(seen):
        figures = find_figures(store, seen)
    return page("measures.html", read_measures(seen, figures))


def _make_time_cell(at_ms: int) -> FormattedCell:
    return FormattedCell(write_time(at_ms))


def read_measures(campaign: Campaign, found: CampaignFigures) -> MeasuresView:
    """Return safety, cost and workers of a campaign."""
    workers = campaigns.tabulate_workers(found.workers, _make_time_cell, MOST_LINES)
    return make_measures_view(campaign, found.safety, found.cost, workers)
