"""Tables: one function for each noun."""

from collections.abc import Iterable, Iterator
from datetime import UTC, datetime

from rich import box
from rich.markup import escape
from rich.table import Table

from eigenfail.cli.figures import UNKNOWN, cost_per_failure, number, probability, rate
from eigenfail.functions import disturbance_in_words
from eigenfail.values import (
    Campaign,
    CampaignSpec,
    Conflicts,
    Counts,
    Estimate,
    MeanTime,
    Summary,
)
from eigenfail.values.variation import in_words

RESULT_COLUMNS = (
    *("id", "method", "episodes", "failures", "failure rate [95 %]", "log p/step", "severity"),
    *("episodes/s", "USD/failure [95 %]"),
)
RESULT_FIGURES = frozenset(RESULT_COLUMNS) - {"method"}
PROBABILITY = ("P(failure) [95 %]",)
"""A column that tables have where a campaign tells of it."""


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
    rows = list(summaries)
    told = any(summary.estimate for summary in rows)
    grid = table(*RESULT_COLUMNS, *told * PROBABILITY, right={*RESULT_FIGURES, *PROBABILITY})
    for summary in rows:
        cells = (*result_row(summary), *told * (probability(summary.estimate),))
        grid.add_row(*map(escape, cells))
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


def campaign_facts(campaign: Campaign) -> Table:
    """One campaign as it stands."""
    spec, counts = campaign.spec, campaign.counts
    rows = [
        ("campaign", f"{campaign.id}: {spec.name}"),
        ("state", " ".join(filter(None, (campaign.state, campaign.stopped_because)))),
        ("method", f"{spec.method} {spec.settings or ''}"),
        ("scenario", " ".join((spec.scenario, parameters(spec)))),
        ("planner", f"{spec.planner} {spec.planner_settings or ''}"),
        ("simulator", f"{spec.simulator}, seed {spec.seed}"),
        ("disturbance", "; ".join(map(" ".join, disturbance_in_words(spec).items()))),
        ("budget", f"{spec.episodes} episodes{rules(spec)}"),
        ("episodes", ", ".join(episodes(counts))),
        ("failures", str(counts.failures)),
        *estimate_facts(campaign.estimate),
        *training_facts(campaign),
        ("created", moment(campaign.created_ms)),
        ("active", f"{campaign.active_s:.1f} s"),
        ("digest", campaign.digest or UNKNOWN),
    ]
    return facts(rows)


def parameters(spec: CampaignSpec) -> str:
    """What was said of the scenario; a distribution in words."""
    said = in_words(spec.scenario_parameters).items()
    return ", ".join(f"{name} = {value}" for name, value in said)


def estimate_facts(estimate: Estimate | None) -> Iterator[tuple[str, str]]:
    """The failure probability with what it rests on, or why it is not told; nothing of none."""
    if estimate is None:
        return
    how = f"{probability(estimate)}, {estimate.by}, cv {number(estimate.cv)}"
    yield "P(failure)", how if estimate.probability is not None else f"unknown, {estimate.by}"
    if remark := estimate.problem or estimate.note:
        yield "", remark


def training_facts(campaign: Campaign) -> Iterator[tuple[str, str]]:
    """How many episodes were trained with; nothing where the method does not say."""
    if campaign.trained_episodes is not None:
        yield "trained with", f"{campaign.trained_episodes} episodes"


def rules(spec: CampaignSpec) -> str:
    """What may end a campaign before its budget is spent."""
    limits = [f"{name} = {limit}" for name, limit in spec.stop.given().items()]
    return f"; stops at {', '.join(limits)}" if limits else ""


def episodes(counts: Counts) -> Iterator[str]:
    """What became of a campaign's episodes."""
    yield f"{counts.completed} completed of {counts.planned}"
    yield f"{counts.failed} failed"
    if counts.cancelled:
        yield f"{counts.cancelled} not run"


def conflict_facts(campaign: Campaign, conflicts: Conflicts) -> Table:
    """The episodes of a campaign by class, and how early its collisions showed."""
    collisions, late = campaign.counts.failures, conflicts.unclassified
    classes = (
        f"{conflicts.unavoidable} unavoidable",
        f"{conflicts.planner_failures} planner failures",
        *([f"{late} not classified"] if late else []),
    )
    return facts(
        [
            ("collisions", f"{collisions} of {campaign.counts.completed}: {', '.join(classes)}"),
            ("near misses", f"{conflicts.near_misses} with MinTTC < 1.5 s"),
            (
                "mean lead time",
                f"{mean(conflicts.ttc_lead)} MinTTC, {mean(conflicts.drac_lead)} DRAC",
            ),
        ]
    )


def mean(time: MeanTime) -> str:
    """A mean time, and what it rests on."""
    return f"{number(time.mean_s)} s (n = {time.n})" if time.n else UNKNOWN


def moment(at_ms: int) -> str:
    """A time in the reader's zone."""
    return datetime.fromtimestamp(at_ms / 1000, UTC).astimezone().strftime("%Y-%m-%d %H:%M:%S")
