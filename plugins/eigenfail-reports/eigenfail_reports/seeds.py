"""The section of a report on campaigns that differ in their seeds alone."""

from eigenfail.presentation.seeds import OVER_SEEDS, tabulate_spreads
from eigenfail.values.seeds import SeedFigure, SeedSpread
from eigenfail_reports.contents import Cell
from eigenfail_reports.material import Material
from eigenfail_reports.page import Grid, ReportPart, make_table
from eigenfail_services.comparison.seeds import make_spreads

TABLE = "over-seeds"

SPREAD_COLUMNS = (
    ("group", "Group"),
    ("method", "Method"),
    ("campaigns", "Campaigns"),
    ("seeds", "Seeds"),
    ("n", "Episodes completed"),
    ("failures", "Failures"),
    ("share", "Share of episodes that failed, mean over seeds", "share"),
    ("share_low", "from", "share"),
    ("share_high", "to", "share"),
    ("share_deviation", "Standard deviation", "share"),
    ("share_least", "Smallest", "share"),
    ("share_median", "Median", "share"),
    ("share_most", "Largest", "share"),
    ("worst_seed", "Seed with the smallest share"),
    ("log_p_per_step", "log p per step of the failures, mean over seeds", "nat"),
    ("log_p_per_step_low", "from", "nat"),
    ("log_p_per_step_high", "to", "nat"),
    ("log_p_per_step_deviation", "Standard deviation", "nat"),
    ("severity", "Severity, mean over seeds", "m²/s²"),
    ("severity_low", "from", "m²/s²"),
    ("severity_high", "to", "m²/s²"),
    ("severity_deviation", "Standard deviation", "m²/s²"),
    ("first_failure", "Episodes to the first failure, median"),
    ("first_failure_worst", "Episodes to the first failure, largest"),
    ("first_failure_worst_seed", "Seed with the latest first failure"),
    ("without_failure", "Seeds without a failure"),
    ("cost_per_failure", "Cost per failure, total price ÷ all failures", "USD"),
    ("cost_per_failure_low", "from", "USD"),
    ("cost_per_failure_high", "to", "USD"),
    ("cost_per_failure_at_least", "Cost per failure at least", "USD"),
    ("cost", "Cost", "USD"),
)

WORDS = (
    "Campaigns that differ in their seeds alone are a random sample of what the same search would "
    "give: an interval of a mean is Student's over the seeds, and that of the cost per failure is "
    "Fieller's for the ratio of total price to all failures. Both widen with the spread between "
    "seeds, not with the number of episodes."
)


def make_over_seeds(material: Material) -> ReportPart | None:
    """Return mean and spread over seeds; None if no campaigns differ in their seeds alone."""
    subjects = material.subjects
    found = make_spreads(
        [subject.campaign for subject in subjects], [subject.summary for subject in subjects]
    )
    if not found:
        return None
    shown = tabulate_spreads(found)
    grid = Grid(
        tuple(column.heading for column in shown.columns),
        tuple(tuple(cell.lines for cell in row) for row in shown.cells),
    )
    return ReportPart(
        name=TABLE,
        title=OVER_SEEDS,
        words=(WORDS, *shown.notes),
        tables=(make_table(TABLE, OVER_SEEDS, SPREAD_COLUMNS, [*map(list_spread_cells, found)]),),
        grids={TABLE: (grid,)},
    )


def list_spread_cells(spread: SeedSpread) -> tuple[Cell, ...]:
    """Return the numbers of campaigns over seeds."""
    share, first, cost = spread.share, spread.first, spread.cost
    bounds = cost.interval_usd
    return (
        spread.name,
        spread.method,
        ", ".join(map(str, spread.campaigns)),
        ", ".join(map(str, spread.seeds)),
        spread.completed,
        spread.failures,
        *_list_mean(share),
        share.least,
        share.median,
        share.most,
        str(spread.worst.seed),
        *_list_mean(spread.log_probability_per_step),
        *_list_mean(spread.mean_severity),
        first.median,
        first.worst,
        str(first.worst_seed),
        first.without,
        cost.per_failure_usd,
        *((bounds.low, bounds.high) if bounds else (None, None)),
        cost.at_least_usd,
        cost.total_usd,
    )


def _list_mean(figure: SeedFigure | None) -> tuple[Cell, ...]:
    """Return mean, both ends of its interval and the standard deviation."""
    if figure is None:
        return (None,) * 4
    bounds = figure.interval
    ends = (None, None) if bounds is None else (bounds.low, bounds.high)
    return (figure.mean, *ends, figure.deviation)
