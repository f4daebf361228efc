"""The list of suites, the page of one, and the page that launches one from its file."""

from collections.abc import Iterator, Mapping, Sequence
from math import ceil
from urllib.parse import quote

import msgspec
from anyio.to_thread import run_sync
from fastapi import APIRouter, Depends, Request
from fastapi.responses import HTMLResponse
from msgspec.structs import replace

from eigenfail.errors import InputError, InvalidValue
from eigenfail.intervals import bound_rate
from eigenfail.presentation import figures
from eigenfail.presentation.figures import count_noun
from eigenfail.presentation.seeds import label_spread, list_spread, tabulate_spreads
from eigenfail.presentation.suites import format_settings, note_omissions
from eigenfail.presentation.tables import format_cell
from eigenfail.suites import SuiteRequest
from eigenfail.values.campaign import FINAL_STATES, CampaignState, describe_early_end
from eigenfail.values.estimates import Rate, RateDesign
from eigenfail.values.suite import SuiteRow, SuiteTable
from eigenfail.wire.http import read_body
from eigenfail_api.concurrency import ConcurrencyLimit
from eigenfail_api.dashboard import launch_page
from eigenfail_api.dashboard.cost_charts import make_cost_chart
from eigenfail_api.dashboard.rendering import Tile, Tiles, make_pager, page
from eigenfail_api.parameters import Before, Stored, read_form
from eigenfail_services.campaigns.suites import check_suite, read_suite
from eigenfail_services.comparison.seeds import make_suite_table
from eigenfail_services.store.store import Store

SEED = "seed"
NO_SETTINGS = "The members differ only in their names."
# As many ids as the comparison accepts for one side.
MOST_COMPARED = 100
"""Maximum number of campaigns of one side in an address."""


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
            failed; None if no member has these values, or no episode was completed.
        level: 0 without a failure, up to `LEVELS` for the largest rate of the map; None for a
            search, whose episodes do not estimate a rate.
        address: page of the member; empty if there are several, or none.
    """

    failures: Tile | None
    level: int | None
    address: str


class HeatMap(msgspec.Struct, frozen=True):
    """Failures by two settings.

    Attributes:
        down: name of the setting whose values are the rows.
        across: name of the setting whose values are the columns.
        columns: values of the setting `across`.
        rows: each value of the setting `down`, with a cell for each column.
    """

    down: str
    across: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[HeatCell, ...]], ...]

    @property
    def legend(self) -> str:
        """Return the sentences on the kinds of cells that the map has."""
        cells = [cell for _, row in self.rows for cell in row if cell.failures]
        has_rates = any(cell.level is not None for cell in cells)
        has_searches = any(cell.level is None for cell in cells)
        return " ".join([OF_RATES] * has_rates + [OF_SEARCHES] * has_searches)


def make_suite_address(suite: str) -> str:
    """Return the address of a suite's page."""
    return f"/suites/{quote(suite, safe='')}"


def make_suite_view(table: SuiteTable) -> dict[str, object]:
    """Return what the page of a suite shows."""
    found = [replace(row.summary, name=row.member) for row in table.members]
    is_equal = not table.columns and len(table.members) > 1
    return {
        "table": table,
        "address": make_suite_address(table.suite),
        "tiles": make_tiles(table),
        "heat": make_heat_map(table),
        "lines": [
            (
                row,
                format_settings(row, table.columns),
                describe_early_end(row.stopped_because, row.summary.counts.planned),
                make_comparison_address(table, row),
            )
            for row in table.members
        ],
        "means": [
            (label_spread(each, len(table.over_seeds) == 1), list_spread(each))
            for each in table.over_seeds
        ],
        "over_seeds": tabulate_spreads(table.over_seeds) if table.over_seeds else None,
        "tells_probability": any(summary.estimate for summary in found),
        "costs": make_cost_chart(found),
        "notes": (*([NO_SETTINGS] if is_equal else []), *note_omissions(table)),
        "is_open": any(row.state not in FINAL_STATES for row in table.members),
    }


LEVELS = 5


def make_heat_map(table: SuiteTable) -> HeatMap | None:
    """Return the map of failures by two settings; None if members differ in fewer or in more."""
    # Seeds repeat a cell; they make no axis of their own.
    varied = [name for name in table.columns if name != SEED]
    if len(varied) != 2:
        return None
    down, across = varied
    found: dict[tuple[str, str], list[SuiteRow]] = {}
    for row in table.members:
        place = format_settings(row, varied)
        found.setdefault((place[0], place[1]), []).append(row)
    rows, columns = (tuple(dict.fromkeys(names)) for names in zip(*found, strict=True))
    if len(rows) < 2 or len(columns) < 2:
        return None
    rates = {place: pool_failures(rows) for place, rows in found.items()}
    sampled = [rate.share for rate in rates.values() if rate and rate.sampled]
    largest = max(sampled, default=0.0)

    def make_cell(place: tuple[str, str]) -> HeatCell:
        return make_heat_cell(found.get(place, []), rates.get(place), largest)

    lines = ((name, tuple(make_cell((name, column)) for column in columns)) for name in rows)
    return HeatMap(down, across, columns, tuple(lines))


def pool_failures(members: Sequence[SuiteRow]) -> Rate | None:
    """Return failures ÷ completed episodes of members of several seeds; None without episodes.

    A pooled rate has an interval only if all members are samples with a fixed number of episodes.
    If a member completed no episode, its errored episodes still count.
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
    # Relative to the map: between rare failures the differences would not be seen.
    level = ceil(LEVELS * rate.share / largest) if largest else 0
    return HeatCell(Tile(told.value, notes), level, address)


def make_tiles(table: SuiteTable) -> Tiles:
    """Return the tiles of sums over the members."""
    counts = [row.summary.counts for row in table.members]
    running = sum(row.state is CampaignState.RUNNING for row in table.members)
    spent = sum(row.summary.cost.total_usd for row in table.members)
    completed, planned, failures = (
        sum(getattr(each, name) for each in counts) for name in ("completed", "planned", "failures")
    )
    return (
        ("Members", Tile(len(counts), (f"{running} running",))),
        ("Episodes", Tile(completed, (f"of {figures.format_count(planned)}",))),
        ("Failures", Tile(failures, ("collisions or violations",))),
        ("Spent", Tile(spent, ("instance-hours × price",), unit="USD")),
    )


def make_comparison_address(table: SuiteTable, row: SuiteRow) -> str:
    """Return the address that compares a member with the first one, all seeds of each included."""
    wanted = [drop_seed(each) for each in (table.members[0], row)]
    # A member compared with its own group would say nothing.
    if wanted[0] == wanted[1]:
        return ""
    a, b = (
        [str(each.campaign) for each in table.members if drop_seed(each) == settings]
        for settings in wanted
    )
    return f"/comparison?a={','.join(a[:MOST_COMPARED])}&b={','.join(b[:MOST_COMPARED])}"


def drop_seed(row: SuiteRow) -> dict[str, object]:
    """Return a member's settings without its seed."""
    return {name: each for name, each in row.settings.items() if name != SEED}


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

SUITES_ON_A_PAGE = 50


@router.get("/suites")
def show_suites(store: Stored, before: Before = None) -> HTMLResponse:
    """Show all suites, those with the newest campaigns first."""
    listed = store.campaigns.suites(SUITES_ON_A_PAGE, before)
    is_open = any(suite.states.keys() - FINAL_STATES for suite in listed.items)
    pages = make_pager("/suites", before, listed.next)
    addresses = [make_suite_address(suite.name) for suite in listed.items]
    lines = list(zip(listed.items, addresses, strict=True))
    return page("suites.html", lines, pages=pages, is_open=is_open)


@router.get("/suites/{suite:path}")
def show_suite(store: Stored, suite: str) -> HTMLResponse:
    """Show a suite."""
    return page("suite.html", make_suite_view(make_suite_table(store, suite)))


PATH = "/launch/suite"


@router.get(PATH)
def show_new_suite() -> HTMLResponse:
    """Serve the page without a file."""
    return page("new_suite.html", {"text": ""})


FORMS = Depends(ConcurrencyLimit("forms of suites"), scope="function")


@router.post(PATH, dependencies=[FORMS])
async def preview_new_suite(request: Request, store: Stored) -> HTMLResponse:
    """Serve the preview of a file; nothing is launched."""
    typed = await read_form(request, launch_page.MOST_FIELDS)
    return page(
        "new_suite.html", await run_sync(preview_suite, store, typed.get(launch_page.TOML, ""))
    )


def preview_suite(store: Store, text: str) -> dict[str, object]:
    """Return what the page shows of a file: its suite, or why there is none."""
    try:
        body = encode_suite(text)
        suite = read_suite(read_body(body, SuiteRequest))
        problems = check_suite(store, suite).problems
    except InputError as error:
        return {"text": text, "troubles": [launch_page.LaunchTrouble(describe_problem(error))]}
    return {
        "text": text,
        "troubles": list(list_member_troubles(problems)),
        "suite": suite,
        "refused": frozenset(problems),
        "body": body.decode(),
        # The same file has the same key, so that a second click launches nothing.
        "key": "" if problems else launch_page.make_key("", msgspec.json.decode(body)),
        "address": make_suite_address(suite.name),
    }


def encode_suite(text: str) -> bytes:
    """Return the file of a suite as the body of the request that creates it.

    Raises:
        InvalidValue: the text is not TOML, or describes a campaign.
    """
    table = launch_page.read_toml(text, "")
    if "method" in table:
        remedy = "Fill in the launch form from it."
        raise InvalidValue("", "The file describes a campaign, not a suite.", remedy)
    try:
        return msgspec.json.encode(table)
    except RecursionError:
        # TOML reads a dotted key of any length without recursion.
        raise InvalidValue("", "The file is nested too deeply.") from None


def list_member_troubles(problems: Mapping[str, InputError]) -> Iterator[launch_page.LaunchTrouble]:
    """Yield each problem once, with the first member that has it and the number of others."""
    named: dict[str, list[str]] = {}
    for name, error in problems.items():
        named.setdefault(describe_problem(error), []).append(name)
    for words, names in named.items():
        more = f" and {count_noun(len(names) - 1, 'other')}" if len(names) > 1 else ""
        yield launch_page.LaunchTrouble(f"{names[0]}{more}: {words}")


def describe_problem(error: InputError) -> str:
    """Return a problem with its field and its remedy."""
    where = f"{error.field}: " if error.field else ""
    return f"{where}{launch_page.describe_error(error)}"
