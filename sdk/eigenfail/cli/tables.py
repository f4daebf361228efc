"""Tables: one function for each noun."""

from collections.abc import Iterable
from datetime import UTC, datetime

from rich import box
from rich.markup import escape
from rich.table import Table

from eigenfail.cli.figures import UNKNOWN, cost_per_failure, number, rate
from eigenfail.values import Campaign, EpisodeResult, Summary
from eigenfail.values.records import EpisodeRow


def table(*columns: str, right: Iterable[str] = ()) -> Table:
    """An empty table; the columns named in `right` hold figures."""
    grid = Table(box=box.SIMPLE_HEAD, show_edge=False, padding=0, header_style="bold")
    figures = frozenset(right)
    for column in columns:
        grid.add_column(escape(column), justify="right" if column in figures else "left")
    return grid


def facts(rows: Iterable[tuple[str, str]]) -> Table:
    """Names and values, one pair a line."""
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="bold")
    grid.add_column(overflow="fold")
    for name, value in rows:
        grid.add_row(escape(name), escape(value))
    return grid


def result_table(summaries: Iterable[Summary]) -> Table:
    """What campaigns found and what it cost: one row each."""
    figures = ("episodes", "failures", "failure rate [95 %]", "log p/step", "severity")
    costs = ("episodes/s", "USD/failure [95 %]")
    grid = table("id", "method", *figures, *costs, right=("id", *figures, *costs))
    for summary in summaries:
        grid.add_row(*(escape(cell) for cell in result_row(summary)))
    return grid


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
    grid = table(
        *("id", "name", "state", "method", "scenario", "planner", "done", "failures", "created"),
        right=("id", "done", "failures"),
    )
    for campaign in campaigns:
        spec, counts = campaign.spec, campaign.counts
        names = (spec.name, campaign.state, spec.method, spec.scenario, spec.planner)
        progress = f"{counts.completed + counts.failed}/{counts.planned}"
        tail = (progress, str(counts.failures), moment(campaign.created_ms))
        grid.add_row(str(campaign.id), *(escape(name) for name in names), *tail)
    return grid


def campaign_facts(campaign: Campaign) -> Table:
    """One campaign as it stands."""
    spec, counts = campaign.spec, campaign.counts
    rows = [
        ("campaign", f"{campaign.id}: {spec.name}"),
        ("state", " ".join(filter(None, (campaign.state, campaign.stopped_because)))),
        ("method", f"{spec.method} {spec.settings or ''}"),
        ("scenario", f"{spec.scenario} {spec.scenario_parameters or ''}"),
        ("planner", f"{spec.planner} {spec.planner_settings or ''}"),
        ("simulator", f"{spec.simulator}, seed {spec.seed}"),
        ("episodes", f"{counts.completed} completed of {counts.planned}, {counts.failed} failed"),
        ("failures", str(counts.failures)),
        ("created", moment(campaign.created_ms)),
        ("active", f"{campaign.active_s:.1f} s"),
        ("digest", campaign.digest or UNKNOWN),
    ]
    return facts(rows)


def episode_table(rows: Iterable[EpisodeRow]) -> Table:
    """A list of episodes; robustness in m, severity in m²/s², times in s, DRAC in m/s²."""
    figures = ("steps", "robustness", "log p", "severity", "min TTC", "max DRAC")
    grid = table("episode", "outcome", *figures, "source", "worker", right=("episode", *figures))
    for row in rows:
        measured = (row.robustness_m, row.log_probability, row.severity, row.min_ttc_s)
        grid.add_row(
            f"{row.campaign}/{row.index}",
            row.outcome,
            str(row.steps),
            *(number(value) for value in (*measured, row.max_drac_mps2)),
            row.source,
            escape(row.worker),
        )
    return grid


def episode_facts(campaign: int, result: EpisodeResult) -> Table:
    """One episode with what was measured."""
    rows = [
        ("episode", f"{campaign}/{result.index}, seed {result.seed}"),
        ("outcome", result.outcome),
        ("steps", str(result.steps)),
        ("disturbances", f"from {result.source}, log p {result.noise.log_probability:.2f}"),
        *((name, number(value, 3)) for name, value in measured(result)),
        ("scene", "stored" if result.scene else "not stored"),
        ("digest", result.digest()),
    ]
    if result.fault:
        rows.append(("problem", f"{result.fault.kind}: {result.fault.message}"))
    return facts(rows)


def measured(result: EpisodeResult) -> list[tuple[str, float | None]]:
    """The measures of an episode by name, with their units."""
    measures = result.measures
    if measures is None:
        return []
    return [
        ("robustness [m]", measures.robustness_m),
        ("severity [m²/s²]", measures.severity),
        ("min TTC [s]", measures.min_ttc_s),
        ("max DRAC [m/s²]", measures.max_drac_mps2),
    ]


def moment(at_ms: int) -> str:
    """A time in the reader's zone."""
    return datetime.fromtimestamp(at_ms / 1000, UTC).astimezone().strftime("%Y-%m-%d %H:%M:%S")
