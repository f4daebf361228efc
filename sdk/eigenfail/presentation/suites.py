"""Tables of suites: the planned campaigns, and their results."""

from collections.abc import Iterable, Iterator, Sequence

import msgspec

from eigenfail.presentation import tables
from eigenfail.presentation.campaigns import ID, PROBABILITY, RESULTS, WITH_SPEED, note_results
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
    """The result of a member; state and summary are None as long as its campaign is missing."""

    name: str
    state: CampaignState | None = None
    stopped_because: str = ""
    summary: Summary | None = None


class SuiteResult(msgspec.Struct, frozen=True):
    """The results of a suite's members.

    Attributes:
        over_seeds: mean and spread of the members that differ only in their seeds.
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
        tables.read_text("Member", "name"),
        tables.read_text("Method", "spec.method"),
        tables.read_text("Scenario", "spec.scenario"),
        tables.read_text("Planner", "spec.planner"),
        tables.read_number("Seed", lambda member: str(member.spec.seed)),
        tables.read_number("Episodes", "spec.episodes"),
        notes=(f"{plan.suite}: {counts} in all",),
    )


def describe_suite_result(result: SuiteResult) -> tuple[tables.Block, ...]:
    """Return the results of the members, one a row, and their means and spread over seeds."""
    return (_tabulate_members(result), *_describe_spreads(result.over_seeds))


def _describe_spreads(spreads: Sequence[SeedSpread]) -> tuple[tables.Block, ...]:
    return ("", tabulate_spreads(spreads)) if spreads else ()


def _tabulate_members(result: SuiteResult) -> tables.Table:
    found = [member.summary for member in result.members if member.summary]
    table = tables.tabulate(
        result.suite,
        result.members,
        tables.read_text("Member", "name"),
        tables.read_text("State", _describe_state),
        tables.Reading(ID, lambda member: member.summary and str(member.summary.campaign)),
        tables.read_text("Method", "summary.method"),
        *_read_summary(WITH_SPEED, found),
        notes=note_results(found),
    )
    means = [("", "", spread.method, *list_spread(spread)) for spread in result.over_seeds]
    return _add_means(table, result.over_seeds, means)


def _describe_state(member: MemberResult) -> str | None:
    if member.state is None or member.summary is None:
        return member.state
    return state_word(member.state, member.summary.counts)


def _read_summary(
    readings: Iterable[tables.Reading], found: Iterable[Summary]
) -> Iterator[tables.Reading]:
    """Yield columns of a member's summary, and of its estimate if any member has one."""
    # A member without a campaign has no summary: its cells are dashes.
    for reading in readings:
        yield reading._replace(read=f"summary.{reading.read}")
    if any(summary.estimate for summary in found):
        yield tables.Reading(PROBABILITY, "summary.estimate")


def _add_means(
    table: tables.Table, spreads: Sequence[SeedSpread], cells: Iterable[tuple[tables.Cell, ...]]
) -> tables.Table:
    """Return the table of a suite with a row of means over seeds for each group of members."""
    width = len(table.columns)
    rows = (
        # A mean has no estimate of the failure probability: its cell is a dash.
        (label_spread(spread, len(spreads) == 1), *row, None)[:width]
        for spread, row in zip(spreads, cells, strict=True)
    )
    return table._replace(rows=(*table.rows, *rows))


def tabulate_suites(suites: Iterable[SuiteStanding]) -> tables.Table:
    """Return a list of suites."""
    return tables.tabulate(
        "Suites",
        suites,
        tables.read_text("Suite", "name"),
        tables.read_text("States", _describe_states),
        tables.read_number("Campaigns", "campaigns"),
        tables.read_number(
            "Episodes",
            lambda suite: f"{format_count(suite.completed)}/{format_count(suite.planned)}",
        ),
        tables.read_number("Failures", "failures"),
    )


def _describe_states(suite: SuiteStanding) -> str:
    return ", ".join(f"{count} {state}" for state, count in suite.state_words.items())


def describe_suite(found: SuiteTable) -> tuple[tables.Block, ...]:
    """Return the members of a suite, with their differing settings."""
    summaries = [row.summary for row in found.members]

    def read_setting(column: str) -> tables.Reading:
        return tables.read_text(column, lambda row: format_settings(row, [column])[0])

    table = tables.tabulate(
        found.suite,
        found.members,
        tables.read_text("Member", "member"),
        tables.read_text("State", lambda row: state_word(row.state, row.summary.counts)),
        *map(read_setting, found.columns),
        tables.Reading(ID, lambda row: str(row.campaign)),
        *_read_summary(RESULTS, summaries),
        notes=note_results(summaries),
    )
    blank = ("",) * (2 + len(found.columns))
    # The service does not know the speed of a suite: its table has no column for that.
    means = [(*blank, *figures, cost) for *figures, _, cost in map(list_spread, found.over_seeds)]
    remarks = " ".join(note_omissions(found))
    return (
        _add_means(table, found.over_seeds, means),
        *([remarks] if remarks else []),
        *_describe_spreads(found.over_seeds),
    )


def format_settings(row: SuiteRow, columns: Iterable[str]) -> tuple[str, ...]:
    """Return the cells of a member's settings in the given columns."""
    # Distributions have words of their own; other values are shown as they were given.
    varied = in_words({name: each for name, each in row.settings.items() if isinstance(each, dict)})
    known = {name: varied.get(name) or _shorten(each) for name, each in row.settings.items()}
    return tuple(known.get(column, DEFAULT) for column in columns)


def _shorten(value: object) -> str:
    return UNKNOWN if value is None else format_value(value)


def note_omissions(found: SuiteTable) -> Iterator[str]:
    """Yield sentences on campaigns of the suite that are not in its table."""
    if found.earlier:
        yield f"Left out: {count_noun(found.earlier, 'earlier campaign')} of the same names."
    if found.left_out:
        yield f"Left out: {count_noun(found.left_out, 'member')} with older campaigns."
