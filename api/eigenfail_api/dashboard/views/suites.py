"""Suites in a list, and one suite as a table of what differs between its members."""

from collections.abc import Iterable, Iterator
from urllib.parse import quote

import msgspec

from eigenfail.suites.changes import text
from eigenfail.values import FINAL_STATES, CampaignState, Page
from eigenfail.values.suite import SuiteRow, SuiteStanding, SuiteTable
from eigenfail.values.variation import in_words
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views import summaries
from eigenfail_api.dashboard.views.campaign_costs import cost_chart
from eigenfail_api.dashboard.views.charts import Chart
from eigenfail_api.dashboard.views.paging import Pager, pager
from eigenfail_api.dashboard.views.states import CAMPAIGN_BADGES, Badge
from eigenfail_api.dashboard.views.summaries import Figure

DEFAULT = "default"
SEED = "seed"
MOST_COMPARED = 100
"""So many campaigns of a side can be named in an address."""


class SuiteLine(msgspec.Struct, frozen=True):
    """A suite in the list; `badges` are the states of its campaigns, with how many are in each."""

    name: str
    address: str
    badges: tuple[tuple[int, Badge], ...]
    campaigns: int
    ended: int
    planned: int
    failures: int


class SuitesView(msgspec.Struct, frozen=True):
    """The list of suites.

    Attributes:
        pages: where one is among them.
    """

    lines: tuple[SuiteLine, ...]
    pages: Pager
    is_open: bool


class MemberLine(msgspec.Struct, frozen=True, kw_only=True):
    """A member's row.

    Attributes:
        settings: its cells in the columns of what differs.
        comparison: the page on which it is compared with the first member; empty for that one.
    """

    name: str
    campaign: int
    badge: Badge
    because: str
    ended: int
    planned: int
    wanted: int
    remaining: str
    settings: tuple[str, ...]
    failures: Figure
    cost: Figure
    likelihood: str
    severity: str
    probability: Figure | None
    comparison: str


class SuiteView(msgspec.Struct, frozen=True, kw_only=True):
    """One suite's page."""

    name: str
    address: str
    tiles: tuple[tuple[str, Figure], ...]
    columns: tuple[str, ...]
    lines: tuple[MemberLine, ...]
    first: str
    tells_probability: bool
    costs: Chart | None
    notes: tuple[str, ...]
    is_open: bool


def suites_view(page: Page[SuiteStanding], before: int | None) -> SuitesView:
    """The list."""
    lines = tuple(map(suite_line, page.items))
    is_open = any(suite.states.keys() - FINAL_STATES for suite in page.items)
    return SuitesView(
        lines=lines,
        pages=pager("/suites", before, page.next),
        is_open=is_open,
    )


def suite_line(suite: SuiteStanding) -> SuiteLine:
    """One of them."""
    return SuiteLine(
        name=suite.name,
        address=address_of(suite.name),
        badges=tuple((count, CAMPAIGN_BADGES[state]) for state, count in suite.states.items()),
        campaigns=suite.campaigns,
        ended=suite.completed,
        planned=suite.planned,
        failures=suite.failures,
    )


def address_of(suite: str) -> str:
    """The page of a suite."""
    return f"/suites/{quote(suite, safe='')}"


def suite_view(table: SuiteTable) -> SuiteView:
    """The page of a suite."""
    found = [msgspec.structs.replace(row.summary, name=row.member) for row in table.members]
    return SuiteView(
        name=table.suite,
        address=address_of(table.suite),
        tiles=tiles(table),
        columns=table.columns,
        lines=tuple(member_line(table, row) for row in table.members),
        first=table.members[0].member,
        tells_probability=any(summary.estimate for summary in found),
        costs=cost_chart(found),
        notes=tuple(notes(table)),
        is_open=any(row.state not in FINAL_STATES for row in table.members),
    )


def tiles(table: SuiteTable) -> tuple[tuple[str, Figure], ...]:
    """Sums over the members."""
    counts = [row.summary.counts for row in table.members]
    running = sum(row.state is CampaignState.RUNNING for row in table.members)
    spent = sum(row.summary.cost.total_usd for row in table.members)
    completed, planned, failures = (
        formats.integer(sum(getattr(each, name) for each in counts))
        for name in ("completed", "planned", "failures")
    )
    return (
        ("Members", Figure(formats.integer(len(counts)), (f"{running} running",))),
        ("Episodes", Figure(completed, (f"of {planned}",))),
        ("Failures", Figure(failures, ("collisions found",))),
        ("Spent", Figure(f"{formats.number(spent)} USD", ("instance-hours × price",))),
    )


def member_line(table: SuiteTable, row: SuiteRow) -> MemberLine:
    """A member's row."""
    summary, counts = row.summary, row.summary.counts
    said = setting_words(row)
    left = f"{formats.integer(counts.cancelled)} not run" if counts.cancelled else ""
    return MemberLine(
        name=row.member,
        campaign=row.campaign,
        badge=CAMPAIGN_BADGES[row.state],
        because=row.stopped_because,
        ended=counts.completed + counts.failed,
        planned=counts.planned,
        wanted=counts.planned - counts.cancelled,
        remaining=left,
        settings=tuple(said.get(column, DEFAULT) for column in table.columns),
        failures=summaries.failures(summary),
        cost=summaries.cost(summary),
        likelihood=formats.number(summary.log_probability_per_step),
        severity=formats.number(summary.mean_severity),
        probability=summaries.probability(summary.estimate),
        comparison=comparison(table, row),
    )


def setting_words(row: SuiteRow) -> dict[str, str]:
    """A member's settings as people read them, by column."""
    drawn = in_words({name: each for name, each in row.settings.items() if isinstance(each, dict)})
    return {
        name: drawn.get(name) or (formats.NONE if each is None else text(each))
        for name, each in row.settings.items()
    }


def comparison(table: SuiteTable, row: SuiteRow) -> str:
    """Where a member is compared with the first one, each with those of other seeds beside it."""
    first = table.members[0]
    if alike(first, row):
        return ""
    a, b = (group(table.members, each) for each in (first, row))
    return f"/comparison?a={a}&b={b}"


def group(members: Iterable[SuiteRow], like: SuiteRow) -> str:
    """The campaigns that differ from one in their seeds alone, as an address names them."""
    found = [str(each.campaign) for each in members if alike(each, like)]
    return ",".join(found[:MOST_COMPARED])


def alike(one: SuiteRow, other: SuiteRow) -> bool:
    """Whether two members differ in their seeds alone."""
    return without_seed(one) == without_seed(other)


def without_seed(row: SuiteRow) -> dict[str, object]:
    """A member's settings but for its seed."""
    return {name: each for name, each in row.settings.items() if name != SEED}


def notes(table: SuiteTable) -> Iterator[str]:
    """What the table leaves out."""
    if not table.columns and len(table.members) > 1:
        yield "The members differ in nothing but their names."
    if table.earlier:
        yield f"Left out: {formats.counted(table.earlier, 'earlier campaign')} of the same names."
    if table.left_out:
        yield f"Left out: {formats.counted(table.left_out, 'member')} with older campaigns."
