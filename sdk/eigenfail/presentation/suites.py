"""Tables of suites: the planned campaigns, and their results."""

from collections.abc import Iterable, Iterator, Sequence

import msgspec

from eigenfail.presentation import tables
from eigenfail.presentation.campaigns import (
    COST,
    ID,
    LIKELIHOOD,
    PROBABILITY,
    RATE,
    RESULTS,
    SEVERITY,
    list_results,
    note_results,
)
from eigenfail.presentation.figures import UNKNOWN, count_noun, format_count
from eigenfail.presentation.seeds import label_spread, list_spread, tabulate_spreads
from eigenfail.suites import SuiteMember, format_value
from eigenfail.values.campaign import CampaignState, state_word
from eigenfail.values.seeds import SeedSpread
from eigenfail.values.suite import SuiteRow, SuiteStanding, SuiteTable
from eigenfail.values.summary import Summary
from eigenfail.values.variation import in_words

DEFAULT = "default"


class SuitePlan(msgspec.Struct, frozen=True):
    """The campaigns that a suite would run.

    Attributes:
        episodes: budget of all members together.
    """

    suite: str
    campaigns: int
    episodes: int
    members: tuple[SuiteMember, ...]


class MemberResult(msgspec.Struct, frozen=True):
    """The result of a member; without state and summary where it has no campaign yet."""

    name: str
    state: CampaignState | None = None
    stopped_because: str = ""
    summary: Summary | None = None


class SuiteResult(msgspec.Struct, frozen=True):
    """The results of a suite's members.

    Attributes:
        over_seeds: mean and spread of the members that differ in their seeds alone.
    """

    suite: str
    episodes: int
    members: tuple[MemberResult, ...]
    over_seeds: tuple[SeedSpread, ...] = ()


def tabulate_plan(plan: SuitePlan) -> tables.Table:
    """Return the campaigns that would run, and their budget."""
    counts = f"{count_noun(plan.campaigns, 'campaign')}, {count_noun(plan.episodes, 'episode')}"
    return tables.tabulate(
        plan.suite,
        plan.members,
        (
            tables.read_text("Member", "name"),
            tables.read_text("Method", "spec.method"),
            tables.read_text("Scenario", "spec.scenario"),
            tables.read_text("Planner", "spec.planner"),
            tables.read_number("Seed", lambda member: str(member.spec.seed)),
            tables.read_number("Episodes", "spec.episodes"),
        ),
        (f"{plan.suite}: {counts} in all",),
    )


def describe_suite_result(result: SuiteResult) -> tuple[tables.Block, ...]:
    """Return the results of the members, one a row, and their means and spread over seeds."""
    return (_tabulate_members(result), *_describe_spreads(result.over_seeds))


def _describe_spreads(spreads: Sequence[SeedSpread]) -> tuple[tables.Block, ...]:
    return ("", tabulate_spreads(spreads)) if spreads else ()


def _tabulate_members(result: SuiteResult) -> tables.Table:
    found = [member.summary for member in result.members if member.summary]
    last = [PROBABILITY] if any(summary.estimate for summary in found) else []
    columns = (
        *tables.name_columns("Member", "State"),
        ID,
        *tables.name_columns("Method"),
        *RESULTS,
        *last,
    )
    rows = tuple(
        tuple(_list_member(member, has_probability=bool(last))) for member in result.members
    )
    means = tuple(
        (
            label_spread(spread, len(result.over_seeds) == 1),
            "",
            "",
            spread.method,
            *list_spread(spread),
            *([None] if last else []),
        )
        for spread in result.over_seeds
    )
    return tables.Table(result.suite, columns, (*rows, *means), note_results(found))


def _list_member(member: MemberResult, *, has_probability: bool) -> Iterator[tables.Cell]:
    yield member.name
    summary = member.summary
    if member.state is None or summary is None:
        yield member.state or UNKNOWN
        yield from (None for _ in (*RESULTS, "id", "method"))
    else:
        yield state_word(member.state, summary.counts)
        yield from (str(summary.campaign), summary.method, *list_results(summary))
    if has_probability:
        yield summary.estimate if summary else None


def tabulate_suites(suites: Iterable[SuiteStanding]) -> tables.Table:
    """Return a list of suites."""
    return tables.tabulate(
        "Suites",
        suites,
        (
            tables.read_text("Suite", "name"),
            tables.read_text("States", _describe_states),
            tables.read_number("Campaigns", "campaigns"),
            tables.read_number(
                "Episodes",
                lambda suite: f"{format_count(suite.completed)}/{format_count(suite.planned)}",
            ),
            tables.read_number("Failures", "failures"),
        ),
    )


def _describe_states(suite: SuiteStanding) -> str:
    return ", ".join(f"{count} {state}" for state, count in suite.state_words.items())


def describe_suite(found: SuiteTable) -> tuple[tables.Block, ...]:
    """Return the members of a suite, with the settings in which they differ."""
    summaries = [row.summary for row in found.members]
    last = [PROBABILITY] if any(summary.estimate for summary in summaries) else []
    columns = (
        *tables.name_columns("Member", "State", *found.columns),
        ID,
        *tables.count_columns("Episodes", "Failures"),
        RATE,
        LIKELIHOOD,
        SEVERITY,
        COST,
        *last,
    )
    rows = tuple(
        (
            row.member,
            state_word(row.state, row.summary.counts),
            *format_settings(row, found.columns),
            str(row.campaign),
            row.summary.counts.completed,
            row.summary.counts.failures,
            row.summary.failure_rate,
            row.summary.log_probability_per_step,
            row.summary.mean_severity,
            row.summary.cost,
            *([row.summary.estimate] if last else []),
        )
        for row in found.members
    )
    means = tuple(
        (
            label_spread(spread, len(found.over_seeds) == 1),
            "",
            *("" for _ in found.columns),
            "",
            *_list_means(spread),
            *([None] if last else []),
        )
        for spread in found.over_seeds
    )
    remarks = " ".join(note_omissions(found))
    table = tables.Table(found.suite, columns, (*rows, *means), note_results(summaries))
    return (table, *([remarks] if remarks else []), *_describe_spreads(found.over_seeds))


def _list_means(spread: SeedSpread) -> tuple[tables.Cell, ...]:
    """Return the cells of means over seeds in the columns of a suite that the service knows."""
    *figures, _, cost = list_spread(spread)
    return (*figures, cost)


def format_settings(row: SuiteRow, columns: Iterable[str]) -> tuple[str, ...]:
    """Return a member's settings in these columns."""
    varied = in_words({name: each for name, each in row.settings.items() if isinstance(each, dict)})
    known = {name: varied.get(name) or _shorten(each) for name, each in row.settings.items()}
    return tuple(known.get(column, DEFAULT) for column in columns)


def _shorten(value: object) -> str:
    return UNKNOWN if value is None else format_value(value)


def note_omissions(found: SuiteTable) -> Iterator[str]:
    """Return which campaigns of the suite are not in its table."""
    if found.earlier:
        yield f"Left out: {count_noun(found.earlier, 'earlier campaign')} of the same names."
    if found.left_out:
        yield f"Left out: {count_noun(found.left_out, 'member')} with older campaigns."
