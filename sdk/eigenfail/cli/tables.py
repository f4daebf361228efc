"""Tables: one function for each noun."""

from collections.abc import Iterable

from rich import box
from rich.console import Group, JustifyMethod, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from eigenfail.cli.figures import cost_per_failure, number, probability, rate
from eigenfail.cli.fitting import Fitting
from eigenfail.cli.moments import moment
from eigenfail.values import Campaign, Summary

RESULT_COLUMNS = (
    *("id", "method", "episodes", "failures", "failure rate [95 %]", "log p/step", "severity"),
    *("episodes/s", "USD/failure [95 %]"),
)
RESULT_FIGURES = frozenset(RESULT_COLUMNS) - {"method"}
PROBABILITY = ("P(failure) [95 %]",)
"""A column that tables have where a campaign tells of it."""


def table(*columns: str, right: Iterable[str] = ()) -> Table:
    """An empty table that fits the screen; the columns named in `right` hold figures."""
    grid = Fitting(box=box.SIMPLE_HEAD, show_edge=False, padding=0, header_style="bold")
    figures = frozenset(right)
    for column in columns:
        is_figure = column in figures
        justify: JustifyMethod = "right" if is_figure else "left"
        grid.add_column(escape(column), justify=justify, no_wrap=is_figure)
    return grid


def facts(rows: Iterable[tuple[str, str]]) -> Table:
    """Names and values, one pair a line."""
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="bold")
    grid.add_column(overflow="fold")
    for name, value in rows:
        grid.add_row(escape(name), escape(value))
    return grid


def result_table(summaries: Iterable[Summary]) -> RenderableType:
    """What campaigns found and what it cost: one row each, and remarks on their failure rates."""
    rows = list(summaries)
    told = any(summary.estimate for summary in rows)
    grid = table(*RESULT_COLUMNS, *told * PROBABILITY, right={*RESULT_FIGURES, *PROBABILITY})
    for summary in rows:
        cells = (*result_row(summary), *told * (probability(summary.estimate),))
        grid.add_row(*map(escape, cells))
    return remarked(grid, rows)


def remarked(grid: Table, summaries: Iterable[Summary]) -> RenderableType:
    """A table, and what is to be known of the failure rates in it."""
    told = [Text(f"Campaign {each.campaign}: {each.remark}") for each in summaries if each.remark]
    return Group(grid, *told) if told else grid


def result_row(summary: Summary) -> tuple[str, ...]:
    """The cells of a campaign in the result table; severity in m²/s²."""
    return (
        str(summary.campaign),
        summary.method,
        str(summary.counts.completed),
        str(summary.counts.failures),
        rate(summary.failure_rate),
        number(summary.log_probability_per_step),
        number(summary.mean_severity, 1),
        number(summary.episodes_per_s, 1),
        cost_per_failure(summary.cost),
    )


def campaign_table(campaigns: Iterable[Campaign]) -> Table:
    """A list of campaigns."""
    rows = list(campaigns)
    told = any(campaign.estimate for campaign in rows)
    grid = table(
        *("id", "name", "state", "method", "scenario", "planner", "done", "failures"),
        *(*told * PROBABILITY, "created"),
        right=("id", "done", "failures", *PROBABILITY),
    )
    for campaign in rows:
        spec, counts = campaign.spec, campaign.counts
        names = (spec.name, campaign.state, spec.method, spec.scenario, spec.planner)
        progress = f"{counts.completed + counts.failed}/{counts.planned}"
        found = (str(counts.failures), *told * (probability(campaign.estimate),))
        cells = (str(campaign.id), *names, progress, *found, moment(campaign.created_ms))
        grid.add_row(*map(escape, cells))
    return grid
