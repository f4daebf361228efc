"""Suites as a service knows them, as they are printed."""

from collections.abc import Iterable, Iterator

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from eigenfail.cli.figures import UNKNOWN, cost_per_failure, number, probability, rate
from eigenfail.cli.tables import PROBABILITY, remarked, table
from eigenfail.suites.changes import text
from eigenfail.values.suite import SuiteRow, SuiteStanding, SuiteTable
from eigenfail.values.variation import in_words

DEFAULT = "default"
FIGURES = (
    *("id", "episodes", "failures", "failure rate [95 %]", "log p/step", "severity"),
    "USD/failure [95 %]",
)


def suite_list(suites: Iterable[SuiteStanding]) -> Table:
    """One row for each suite."""
    figures = ("campaigns", "episodes", "failures")
    grid = table("suite", "states", *figures, right=figures)
    for suite in suites:
        states = ", ".join(f"{count} {state}" for state, count in suite.states.items())
        episodes = f"{suite.completed}/{suite.planned}"
        cells = (suite.name, states, str(suite.campaigns), episodes, str(suite.failures))
        grid.add_row(*map(escape, cells))
    return grid


def named_suite(found: SuiteTable) -> RenderableType:
    """One row for each member; of its settings only what differs between members."""
    told = any(row.summary.estimate for row in found.members)
    figures = (*FIGURES, *told * PROBABILITY)
    grid = table("member", "state", *found.columns, *figures, right=figures)
    for row in found.members:
        last = told * (probability(row.summary.estimate),)
        grid.add_row(*map(escape, (*cells(row, found.columns), *last)))
    remarks = " ".join(remarks_on(found))
    page = remarked(grid, (row.summary for row in found.members))
    return Group(page, Text(remarks)) if remarks else page


def cells(row: SuiteRow, columns: Iterable[str]) -> Iterator[str]:
    """A member's row, but for the probability; severity in m²/s²."""
    summary, said = row.summary, setting_words(row)
    yield row.member
    yield row.state
    yield from (said.get(column, DEFAULT) for column in columns)
    yield str(row.campaign)
    yield str(summary.counts.completed)
    yield str(summary.counts.failures)
    yield rate(summary.failure_rate)
    yield number(summary.log_probability_per_step)
    yield number(summary.mean_severity, 1)
    yield cost_per_failure(summary.cost)


def setting_words(row: SuiteRow) -> dict[str, str]:
    """A member's settings as people read them, by column."""
    drawn = in_words({name: each for name, each in row.settings.items() if isinstance(each, dict)})
    return {name: drawn.get(name) or shortened(each) for name, each in row.settings.items()}


def shortened(value: object) -> str:
    """A value in its shortest form; none is a dash."""
    return UNKNOWN if value is None else text(value)


def remarks_on(found: SuiteTable) -> Iterator[str]:
    """Which campaigns of the suite are not in its table."""
    if found.earlier:
        yield f"{found.earlier} earlier campaigns of the same names are left out."
    if found.left_out:
        yield f"{found.left_out} members with older campaigns are left out."
