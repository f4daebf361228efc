"""Safety, cost and workers of a campaign, which take longer to compute than its page."""

from fastapi import APIRouter
from fastapi.responses import HTMLResponse

from eigenfail.presentation import campaigns, tables
from eigenfail.presentation.figures import (
    count_noun,
    format_count,
    format_number,
    format_usd,
)
from eigenfail.values.campaign import FINAL_STATES, Campaign
from eigenfail.values.records import IN_WORDS
from eigenfail.values.safety import FailurePoint, Safety, Scatter
from eigenfail.values.summary import CampaignCost, TimeSplit
from eigenfail.worlds import world_of
from eigenfail_api.dashboard.charts import Chart, collect_floats, tabulate_first
from eigenfail_api.dashboard.overview_page import MOST_LINES
from eigenfail_api.dashboard.rendering import Tile, Tiles, page, write_time
from eigenfail_api.parameters import CampaignId, Stored
from eigenfail_api.routes.analyses import COSTS
from eigenfail_services.campaigns.costs import CampaignFigures, find_figures

NOT_CLASSIFIED = "not classified"
COLLISION = "collision, "


def make_scatter_chart(scatter: Scatter) -> Chart:
    """Return the chart of the failures' likelihood and severity."""
    points = scatter.points
    # That all are drawn needs no words.
    counts = f"{format_count(len(points))} of {format_count(scatter.of)}."
    drawn = counts if len(points) < scatter.of else ""
    return Chart(
        id="likelihood-chart",
        kind="likelihood",
        title="Likelihood and severity of failures",
        caption=(
            "Each failure: log-probability of its noise per step, and severity [m²/s²]. Up and to "
            f"the right are the likely and severe ones. {drawn}"
        ),
        data={
            "index": [point.index for point in points],
            "likelihood": collect_floats(point.log_probability_per_step for point in points),
            "severity": collect_floats(point.severity for point in points),
            "kind": [describe_kind(point) for point in points],
        },
        table=tabulate_first(
            points,
            tables.read_text("Episode", lambda point: str(point.index)),
            tables.read_number("log p per step", "log_probability_per_step"),
            tables.read_number("Severity", "severity", "m²/s²"),
            tables.read_text("Class", describe_kind),
        ),
    )


def describe_kind(point: FailurePoint) -> str:
    """Return the class of a collision: unavoidable, planner failure, or not classified."""
    words = IN_WORDS[point.conflict] if point.conflict else NOT_CLASSIFIED
    return words.removeprefix(COLLISION)


PARTS = {
    "Simulation": ("simulation_s", "simulating on a worker"),
    "Start-up": ("startup_s", "learner starting or proposing, no episode on a worker"),
    "Learning": ("learning_s", "learner busy, no episode on a worker"),
    "Waiting": ("waiting_s", "for workers or for the database"),
    "Lost": ("lost_s", "discarded results"),
}


def make_cost_tiles(found: CampaignCost) -> Tiles:
    """Return the tiles of total cost and of cost per failure."""
    hours = f"{format_number(found.cost.instance_hours)} instance-hours"
    price = f"at {format_usd(found.price_usd_per_hour)} USD/h × {found.instances}"
    each, failures = tables.format_cost(found.cost), count_noun(found.failures, "failure")
    of_mode = Tile(None, ("no distinct modes found",))
    if found.modes is not None:
        modes = count_noun(found.modes, "distinct mode")
        of_mode = Tile(found.per_mode_usd, (modes,), unit="USD")
    return (
        ("Spent", Tile(found.cost.total_usd, (hours, price), unit="USD")),
        ("Per failure", Tile(each.value, (failures, *each.notes) if found.completed else ())),
        ("Per distinct mode", of_mode),
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
            "usd": collect_floats(point.usd for point in points),
            "failures": [point.failures for point in points],
            "modes": [point.modes for point in points] if known else None,
        },
        table=tables.tabulate(
            "",
            points,
            tables.read_text("USD", lambda point: format_usd(point.usd)),
            tables.read_number("Active", "active_s", "s"),
            tables.read_number("Episodes", "completed"),
            tables.read_number("Failures", "failures"),
            tables.read_number("Modes", "modes"),
        ),
    )


def list_time(time: TimeSplit) -> tuple[tuple[str, str, float, float], ...]:
    """Return name, meaning, share and duration [s] of each part of the time that was billed."""
    # Shares of no time are not defined.
    if time.active_s <= 0.0:
        return ()
    lasted = {name: getattr(time, field) for name, (field, _) in PARTS.items()}
    return tuple(
        (name, meaning, lasted[name] / time.active_s, lasted[name])
        for name, (_, meaning) in PARTS.items()
    )


def make_measures_view(
    campaign: Campaign, safety: Safety, cost: CampaignCost, workers: tables.Table
) -> dict[str, object]:
    """Return the content of the page, without parts that lack values."""
    some, has_road = safety.completed > 0, world_of(campaign.spec.simulator).has_road
    remarks = filter(None, (safety.severity.problem, *safety.notes))
    return {
        "campaign": campaign,
        "basis": describe_basis(campaign, safety.completed, cost.completed),
        "safety": campaigns.tabulate_safety_measures(safety) if some and has_road else None,
        "severity": campaigns.list_severity(safety) if safety.severity.n else (),
        "remarks": tuple(remarks),
        "scatter": make_scatter_chart(safety.scatter) if safety.scatter.points else None,
        "cost": cost if some else None,
        "cost_tiles": make_cost_tiles(cost),
        "cost_chart": make_curve_chart(cost) if len(cost.curve) > 1 else None,
        "time": list_time(cost.time),
        "workers": workers,
    }


def describe_basis(campaign: Campaign, completed: int, billed: int) -> str:
    """Return the number of episodes behind the figures; the page's others may have more."""
    is_open = campaign.state not in FINAL_STATES
    if not completed and is_open:
        return "Safety measures and cost appear after the first episode."
    if not completed:
        return "No episode was completed: there are no safety measures, and no failure has a price."
    if is_open:
        so_many = count_noun(completed, "completed episode")
        # Bill and results are written one after the other: they may differ by some episodes.
        further = f"; cost as of {format_count(billed)}" if billed != completed else ""
        return f"As of {so_many}{further}; updated less often than the figures above."
    return f"Over all completed episodes: {format_count(completed)}."


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)


@router.get("/campaigns/{campaign}/measures", dependencies=[COSTS])
def show_measures(store: Stored, campaign: CampaignId) -> HTMLResponse:
    """Show safety, cost and workers of a campaign, which the campaign's page loads later."""
    seen = store.campaigns.get(campaign)
    # Safety, cost and workers must be of one state of the campaign.
    with store.figures.as_of(seen):
        figures = find_figures(store, seen)
    return page("measures.html", read_measures(seen, figures))


def _make_time_cell(at_ms: int) -> tables.FormattedCell:
    return tables.FormattedCell(write_time(at_ms))


def read_measures(campaign: Campaign, found: CampaignFigures) -> dict[str, object]:
    """Return safety, cost and workers of a campaign."""
    workers = campaigns.tabulate_workers(found.workers, _make_time_cell, MOST_LINES)
    return make_measures_view(campaign, found.safety, found.cost, workers)
