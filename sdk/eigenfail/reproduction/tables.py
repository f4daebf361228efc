"""The paper's tables of campaigns, filled from the summaries of ours."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import msgspec

from eigenfail.reproduction import published
from eigenfail.reproduction.programme import LEARNERS, MOVED_M
from eigenfail.reproduction.published import Rows
from eigenfail.reproduction.results import Column, Number, PaperTable, Row
from eigenfail.values import Summary

Summaries = Mapping[str, Summary]
Read = Callable[[Summary], Number]

PER_STEP = "Our episodes have 100 steps, the paper's about 800: compare log p by step, not as sums."
COST = "Cost at 1.20 USD per instance-hour; the paper's simulator needs 30 to 50 s for an episode."


def rate(of: Summary) -> Number:
    """Collisions ÷ completed episodes."""
    if of.failure_rate is None:
        return Number(None, 0)
    return Number(of.failure_rate.value, of.failure_rate.n, of.failure_rate.interval)


def mean_of_failures(value: Callable[[Summary], float | None]) -> Read:
    """A mean over the failures."""
    return lambda of: Number(value(of), of.counts.failures)


def cost(of: Summary) -> Number:
    """Cost per failure [USD]."""
    return Number(of.cost.per_failure_usd, of.counts.failures, of.cost.interval_usd)


def hours(of: Summary) -> Number:
    """Time during which the campaign was running [h]."""
    return Number(of.cost.instance_hours, of.counts.completed)


RATE = (Column("failure_rate", "failure rate", "share"), rate)
LOG_P = (
    Column("log_p", "mean log p", "nat"),
    mean_of_failures(lambda of: of.mean_log_probability),
)
PER_STEP_P = (
    Column("log_p_per_step", "log p per step", "nat"),
    mean_of_failures(lambda of: of.log_probability_per_step),
)
SEVERITY = (
    Column("severity", "mean severity", "m²/s²"),
    mean_of_failures(lambda of: of.mean_severity),
)
COST_USD = (Column("cost_usd", "cost per failure", "USD"), cost)
HOURS = (Column("hours", "instance-hours", "h"), hours)


class Layout(NamedTuple):
    """What a table shows: which campaigns, and what of each; `rows` are the paper's numbers."""

    name: str
    title: str
    columns: Sequence[tuple[Column, Read]]
    rows: Rows
    note: str = ""


def both(rows: Rows, suffix: str) -> Rows:
    """The paper's numbers of a method, beside our defaults and beside the paper's settings."""
    return {
        f"{name}{suffix}": rows[f"{name.removesuffix('_paper')}_paper{suffix}"] for name in LEARNERS
    }


def moved() -> Rows:
    """The same of AST where the cut-in moves."""
    places = (" evaluation", *(f" {place}" for place in MOVED_M))
    return {
        f"{name}{place}": published.GENERALISATION[f"ast_paper{place}"]
        for name in ("ast", "ast_paper")
        for place in places
    }


SEARCHES = (HOURS, RATE, COST_USD, LOG_P, PER_STEP_P, SEVERITY)

LAYOUTS = (
    Layout("planners", "Planners under Monte Carlo", (RATE, SEVERITY), published.PLANNERS),
    Layout(
        "sweep",
        "Sweep of AST's settings",
        (RATE, LOG_P, PER_STEP_P, SEVERITY),
        published.SWEEP,
        PER_STEP,
    ),
    Layout("training", "Training", SEARCHES, both(published.TRAINING, ""), f"{PER_STEP} {COST}"),
    Layout(
        "evaluation",
        "Evaluation",
        SEARCHES,
        {
            "monte_carlo rulebook": published.EVALUATION["monte_carlo rulebook"],
            **both(published.EVALUATION, " evaluation"),
        },
        f"{PER_STEP} {COST}",
    ),
    Layout("generalisation", "AST where the cut-in moves", (RATE, SEVERITY), moved()),
)
"""In the paper's order."""


def campaign_tables(found: Summaries) -> Iterator[PaperTable]:
    """The tables, each with one row for every campaign that there is."""
    for layout in LAYOUTS:
        rows = (row(name, found[name], layout) for name in layout.rows if name in found)
        columns = tuple(column for column, _ in layout.columns)
        yield PaperTable(layout.name, layout.title, columns, tuple(rows), layout.note)


def row(name: str, of: Summary, layout: Layout) -> Row:
    """Our numbers of a campaign, each with the paper's."""
    paper = layout.rows[name]
    numbers = ((column, read(of)) for column, read in layout.columns)
    beside = (
        msgspec.structs.replace(number, paper=paper.get(column.name)) for column, number in numbers
    )
    return Row(name, tuple(beside), of.campaign)
