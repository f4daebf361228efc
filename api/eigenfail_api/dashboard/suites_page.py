"""The list of suites, and the page of one."""

from collections.abc import Iterable, Iterator, Sequence
from math import ceil
from urllib.parse import quote

import msgspec
from fastapi import APIRouter
from fastapi.responses import HTMLResponse
from msgspec.structs import replace

from eigenfail.intervals import bound_rate
from eigenfail.presentation import figures
from eigenfail.presentation.seeds import label_spread, list_spread, tabulate_spreads
from eigenfail.presentation.tables import Table, format_cell
from eigenfail.suites import format_value
from eigenfail.values import FINAL_STATES, CampaignState, Page, Rate, RateDesign
from eigenfail.values.campaign import describe_early_end
from eigenfail.values.episode import ERRORED
from eigenfail.values.seeds import SeedSpread
from eigenfail.values.suite import SuiteRow, SuiteStanding, SuiteTable
from eigenfail.values.variation import in_words
from eigenfail_api.dashboard import rendering
from eigenfail_api.dashboard.charts import Chart
from eigenfail_api.dashboard.cost_charts import make_cost_chart
from eigenfail_api.dashboard.rendering import (
    CAMPAIGN_BADGES,
    ERRORED_BADGE,
    Badge,
    Pager,
    Tile,
    make_campaign_badge,
    make_pager,
    page,
)
from eigenfail_api.parameters import Before, Stored
from eigenfail_services.comparison.seeds import make_suite_table

DEFAULT = "default"
SEED = "seed"
MOST_COMPARED = 100
"""Maximum number of campaigns of one side in an address."""


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
    failures: Tile
    cost: Tile
    likelihood: str
    severity: str
    probability: Tile | None
    comparison: str


class MeanLine(msgspec.Struct, frozen=True, kw_only=True):
    """The row of means over the seeds of a group."""

    name: str
    failures: Tile
    cost: Tile
    likelihood: Tile
    severity: Tile


OF_RATES = (
    "Rates under p(x) with their 95 % intervals; the stronger the colour, the larger the rate."
)
OF_SEARCHES = (
    "Hatched cells are of methods that search: numbers of failures among the episodes that the "
    "method chose, which say nothing of a rate."
)


class HeatCell(msgspec.Struct, frozen=True):
    """Failures of the members that have one pair of values.

    Attributes:
        failures: rate under p(x) with its interval, or how many of the episodes that a search chose
            failed; None where no member has these values, or no episode was completed.
        level: 0 without a failure, up to `LEVELS` for the largest rate of the map; None of a
            search, whose episodes say nothing of a rate.
        address: page of the member; empty where there are several, or none.
    """

    failures: Tile | None
    level: int | None
    address: str


class HeatMap(msgspec.Struct, frozen=True):
    """Failures by two settings.

    Attributes:
        down: name of the setting whose values are the rows.
        across: name of the setting whose values are the columns.
        columns: values of the latter.
        rows: each value of the former, with a cell for each column.
    """

    down: str
    across: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[HeatCell, ...]], ...]

    @property
    def legend(self) -> str:
        """The sentences on the kinds of cells that the map has."""
        cells = [cell for _, row in self.rows for cell in row if cell.failures]
        has_rates = any(cell.level is not None for cell in cells)
        has_searches = any(cell.level is None for cell in cells)
        return " ".join([OF_RATES] * has_rates + [OF_SEARCHES] * has_searches)


class SuiteView(msgspec.Struct, frozen=True, kw_only=True):
    """One suite's page.

    Attributes:
        heat: map of the failures; None unless the members differ in two settings, seeds aside.
        means: a row for each group of members that differ in their seeds alone.
        over_seeds: mean and spread of these groups; None without one.
    """

    name: str
    address: str
    tiles: tuple[tuple[str, Tile], ...]
    columns: tuple[str, ...]
    heat: HeatMap | None
    lines: tuple[MemberLine, ...]
    means: tuple[MeanLine, ...]
    over_seeds: Table | None
    first: str
    tells_probability: bool
    costs: Chart | None
    notes: tuple[str, ...]
    is_open: bool


def make_suites_view(page: Page[SuiteStanding], before: int | None) -> SuitesView:
    """Return the list of suites."""
    lines = tuple(map(make_suite_line, page.items))
    is_open = any(suite.states.keys() - FINAL_STATES for suite in page.items)
    return SuitesView(
        lines=lines,
        pages=make_pager("/suites", before, page.next),
        is_open=is_open,
    )


def make_suite_line(suite: SuiteStanding) -> SuiteLine:
    """Return the line of a suite."""
    return SuiteLine(
        name=suite.name,
        address=make_suite_address(suite.name),
        badges=tuple((count, make_badge(word)) for word, count in suite.state_words.items()),
        campaigns=suite.campaigns,
        ended=suite.completed,
        planned=suite.planned,
        failures=suite.failures,
    )


def make_badge(word: str) -> Badge:
    """Return the badge of a state's label."""
    return ERRORED_BADGE if word == ERRORED else CAMPAIGN_BADGES[CampaignState(word)]


def make_suite_address(suite: str) -> str:
    """Return the address of a suite's page."""
    return f"/suites/{quote(suite, safe='')}"


def make_suite_view(table: SuiteTable) -> SuiteView:
    """Return the page of a suite."""
    found = [msgspec.structs.replace(row.summary, name=row.member) for row in table.members]
    return SuiteView(
        name=table.suite,
        address=make_suite_address(table.suite),
        tiles=make_tiles(table),
        columns=table.columns,
        heat=make_heat_map(table),
        lines=tuple(make_member_line(table, row) for row in table.members),
        means=tuple(make_mean_line(each, table) for each in table.over_seeds),
        over_seeds=tabulate_spreads(table.over_seeds) if table.over_seeds else None,
        first=table.members[0].member,
        tells_probability=any(summary.estimate for summary in found),
        costs=make_cost_chart(found),
        notes=tuple(list_notes(table)),
        is_open=any(row.state not in FINAL_STATES for row in table.members),
    )


LEVELS = 5


def make_heat_map(table: SuiteTable) -> HeatMap | None:
    """Return the map of failures by two settings; None where members differ in fewer or in more."""
    varied = [name for name in table.columns if name != SEED]
    if len(varied) != 2:
        return None
    down, across = varied
    found: dict[tuple[str, str], list[SuiteRow]] = {}
    for row in table.members:
        told = describe_settings(row)
        found.setdefault((told.get(down, DEFAULT), told.get(across, DEFAULT)), []).append(row)
    rows, columns = (tuple(dict.fromkeys(names)) for names in zip(*found, strict=True))
    if len(rows) < 2 or len(columns) < 2:
        return None
    rates = {place: pool_failures(rows) for place, rows in found.items()}
    sampled = [rate.share for rate in rates.values() if rate and rate.sampled]
    largest = max(sampled, default=0.0)
    return HeatMap(
        down,
        across,
        columns,
        tuple(
            (
                name,
                tuple(
                    make_heat_cell(
                        found.get((name, column), []), rates.get((name, column)), largest
                    )
                    for column in columns
                ),
            )
            for name in rows
        ),
    )


def pool_failures(members: Sequence[SuiteRow]) -> Rate | None:
    """Return failures ÷ completed episodes of members of several seeds; None before the first one.

    Only samples whose number of episodes was fixed have an interval together. Episodes of a member
    that completed none are errored ones of all members.
    """
    known = [rate for row in members if (rate := row.summary.failure_rate) is not None]
    lost = sum(row.summary.counts.errored for row in members if row.summary.failure_rate is None)
    if len(known) < 2 and not (known and lost):
        return known[0] if known else None
    k, n, errored, unresolved = (
        sum(getattr(each, name) for each in known) for name in ("k", "n", "errored", "unresolved")
    )
    errored += lost
    is_sample = all(each.sampled for each in known)
    is_fixed = all(each.design is RateDesign.FIXED for each in known)
    counts = (k, n, None, is_sample)
    pooled = Rate(k / n, *counts, errored=errored, unresolved=unresolved)
    return replace(pooled, interval=bound_rate(pooled)) if is_sample and is_fixed else pooled


def make_heat_cell(members: Sequence[SuiteRow], rate: Rate | None, largest: float) -> HeatCell:
    """Return the cell of some members, whose colour is relative to the largest rate of the map."""
    address = f"/campaigns/{members[0].campaign}" if len(members) == 1 else ""
    if rate is None:
        return HeatCell(None, None, address)
    counted = f"{figures.format_count(rate.k)} of {figures.format_count(rate.n)}"
    unresolved = sum(row.summary.unresolved.count for row in members)
    more = (f"{figures.format_count(unresolved)} unresolved",) if unresolved else ()
    if not rate.sampled:
        return HeatCell(Tile(counted, ("chosen by the search", *more)), None, address)
    told = format_cell(rate)
    notes = (*((counted,) if rate.k else ()), *told.notes, *more)
    level = ceil(LEVELS * rate.share / largest) if largest else 0
    return HeatCell(Tile(told.value, notes), level, address)


def make_tiles(table: SuiteTable) -> tuple[tuple[str, Tile], ...]:
    """Return the tiles of sums over the members."""
    counts = [row.summary.counts for row in table.members]
    running = sum(row.state is CampaignState.RUNNING for row in table.members)
    spent = sum(row.summary.cost.total_usd for row in table.members)
    completed, planned, failures = (
        figures.format_count(sum(getattr(each, name) for each in counts))
        for name in ("completed", "planned", "failures")
    )
    return (
        ("Members", Tile(figures.format_count(len(counts)), (f"{running} running",))),
        ("Episodes", Tile(completed, (f"of {planned}",))),
        ("Failures", Tile(failures, ("collisions or violations",))),
        ("Spent", Tile(f"{figures.format_usd(spent)} USD", ("instance-hours × price",))),
    )


def make_member_line(table: SuiteTable, row: SuiteRow) -> MemberLine:
    """Return the line of a member."""
    summary, counts = row.summary, row.summary.counts
    said = describe_settings(row)
    left = f"{figures.format_count(counts.cancelled)} not run" if counts.cancelled else ""
    return MemberLine(
        name=row.member,
        campaign=row.campaign,
        badge=make_campaign_badge(row.state, summary.counts),
        because=describe_early_end(row.stopped_because, counts.planned),
        ended=counts.completed + counts.errored,
        planned=counts.planned,
        wanted=counts.planned - counts.cancelled,
        remaining=left,
        settings=tuple(said.get(column, DEFAULT) for column in table.columns),
        failures=rendering.make_failure_tile(summary),
        cost=rendering.make_cost_tile(summary),
        likelihood=figures.format_number(summary.log_probability_per_step),
        severity=figures.format_number(summary.mean_severity),
        probability=rendering.make_probability_tile(summary.estimate),
        comparison=make_comparison_address(table, row),
    )


def make_mean_line(spread: SeedSpread, table: SuiteTable) -> MeanLine:
    """Return the line of means over the seeds of a group."""
    _, _, share, likelihood, severity, _, cost = map(format_cell, list_spread(spread))
    return MeanLine(
        name=label_spread(spread, len(table.over_seeds) == 1),
        failures=Tile(share.value, share.notes),
        cost=Tile(figures.put_unit(cost.value, "USD"), cost.notes),
        likelihood=Tile(likelihood.value, likelihood.notes),
        severity=Tile(severity.value, severity.notes),
    )


def describe_settings(row: SuiteRow) -> dict[str, str]:
    """Return a member's settings as text, by column."""
    drawn = in_words({name: each for name, each in row.settings.items() if isinstance(each, dict)})
    return {
        name: drawn.get(name) or (figures.UNKNOWN if each is None else format_value(each))
        for name, each in row.settings.items()
    }


def make_comparison_address(table: SuiteTable, row: SuiteRow) -> str:
    """Return the address that compares a member with the first one, all seeds of each included."""
    first = table.members[0]
    if differ_by_seed(first, row):
        return ""
    a, b = (group(table.members, each) for each in (first, row))
    return f"/comparison?a={a}&b={b}"


def group(members: Iterable[SuiteRow], like: SuiteRow) -> str:
    """The campaigns that differ from one in their seeds alone, as an address names them."""
    found = [str(each.campaign) for each in members if differ_by_seed(each, like)]
    return ",".join(found[:MOST_COMPARED])


def differ_by_seed(one: SuiteRow, other: SuiteRow) -> bool:
    """Whether two members differ in their seeds alone."""
    return drop_seed(one) == drop_seed(other)


def drop_seed(row: SuiteRow) -> dict[str, object]:
    """Return a member's settings without its seed."""
    return {name: each for name, each in row.settings.items() if name != SEED}


def list_notes(table: SuiteTable) -> Iterator[str]:
    """Return the notes on what the table leaves out."""
    if not table.columns and len(table.members) > 1:
        yield "The members differ only in their names."
    if table.earlier:
        earlier = figures.count_noun(table.earlier, "earlier campaign")
        yield f"Left out: {earlier} of the same names."
    if table.left_out:
        yield f"Left out: {figures.count_noun(table.left_out, 'member')} with older campaigns."


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

SUITES_ON_A_PAGE = 50


@router.get("/suites")
def show_suites(store: Stored, before: Before = None) -> HTMLResponse:
    """All suites, those with the newest campaigns first."""
    listed = store.campaigns.suites(SUITES_ON_A_PAGE, before)
    return page("suites.html", make_suites_view(listed, before))


@router.get("/suites/{suite:path}")
def show_suite(store: Stored, suite: str) -> HTMLResponse:
    """One suite."""
    return page("suite.html", make_suite_view(make_suite_table(store, suite)))
