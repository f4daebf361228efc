"""The page on which episodes are searched and sorted, and the rows of its list."""

from collections.abc import Callable
from functools import partial
from typing import Annotated, NamedTuple
from urllib.parse import urlencode

import msgspec
from fastapi import APIRouter, Depends, Query
from fastapi.responses import HTMLResponse

from eigenfail import filters
from eigenfail.errors import InputError
from eigenfail.presentation.figures import count_noun, format_number
from eigenfail.values.campaign import Campaign
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.records import ConflictClass, EpisodeRow, Page
from eigenfail.wire.http import PREFIX
from eigenfail.worlds import find_robustness_unit
from eigenfail_api.dashboard.charts import make_parallel_chart, spread
from eigenfail_api.dashboard.rendering import Badge, make_outcome_badge, page
from eigenfail_api.parameters import LARGEST, CampaignId, Stored
from eigenfail_services.export_formats import has_pyarrow
from eigenfail_services.store.store import Store

ALL_ERRORED = "No episode was completed: all of them errored."


class SortedColumn(NamedTuple):
    """A column that a list can be sorted by.

    Attributes:
        name: name of the column, as in filters.
        label: text of the column head, above the unit.
        largest_first: whether the largest values are of interest, and come first.
        is_minor: whether small screens omit the column.
    """

    name: str
    label: str
    unit: str = ""
    largest_first: bool = True
    is_minor: bool = True


FIGURES = (
    SortedColumn("severity", "Severity", "m²/s²", is_minor=False),
    SortedColumn("log_probability_per_step", "log p", "per step", is_minor=False),
    SortedColumn("robustness_m", "Robustness", "m", largest_first=False),
    SortedColumn("min_ttc_s", "MinTTC", "s", largest_first=False),
    SortedColumn("max_drac_mps2", "DRAC", "m/s²"),
    SortedColumn("ttc_lead_s", "TTC lead", "s"),
    SortedColumn("drac_lead_s", "DRAC lead", "s"),
    SortedColumn("steps", "Steps"),
)
"""Figures of an episode in a list."""


class EpisodeRequest(msgspec.Struct, frozen=True):
    """A list of episodes, as in the address of its page."""

    filter: str
    sort: filters.SortOrder
    after: int | None = None


class EpisodeLine(msgspec.Struct, frozen=True):
    """An episode in a list, with its cells as text.

    Attributes:
        address: page of the episode; includes the list, so that the page can lead to the next
            episode.
        conflict: conflict class, shown next to the outcome.
        cells: figures, as in `FIGURES`.
    """

    row: EpisodeRow
    address: str
    badge: Badge
    conflict: str
    cells: tuple[str, ...]


class Heading(msgspec.Struct, frozen=True):
    """The head of a column that a list can be sorted by.

    Attributes:
        address: address of the list, sorted by the column.
        order: ascending or descending if the list is now sorted by the column; empty if not.
    """

    column: SortedColumn
    address: str
    order: str = ""


def make_episode_list(
    campaign: Campaign,
    page: Page[EpisodeRow],
    sort: filters.SortOrder,
    after: int | None = None,
) -> dict[str, object]:
    """Return the list of failures that begins after a cursor in an order."""
    failures = filters.write_failure_filter(campaign.spec)
    return {
        "campaign": campaign.id,
        "every": make_address(campaign.id, failures),
        "worst": make_address(campaign.id, failures, find_worst_order(campaign.spec)),
        "sort": str(sort),
        "headings": make_headings(
            campaign.spec, partial(make_address, campaign.id, failures), sort
        ),
        "lines": tuple(
            make_episode_line(row, EpisodeRequest(failures, sort)) for row in page.items
        ),
        "next": page.next,
        # New failures appear behind this one.
        "last": page.items[-1].index if page.items else after,
        "is_open": may_grow(campaign),
        "nothing": ALL_ERRORED if campaign.counts.all_errored else "No failure was found.",
    }


def find_failure_order(campaign: Campaign) -> filters.SortOrder:
    """Return the order of the list of failures: the worst first, once no more can come."""
    # New failures are added at the end of a list that stands by index; in another order they would
    # have to move what is being read.
    return (
        filters.BY_INDEX
        if may_grow(campaign)
        else filters.parse_sort(find_worst_order(campaign.spec))
    )


def may_grow(campaign: Campaign) -> bool:
    """Return whether results may still arrive."""
    # A campaign may be open without an episode to come: its last results are on their way.
    return campaign.ended_ms is None and campaign.counts.open > 0


def make_episode_line(row: EpisodeRow, asked: EpisodeRequest | None = None) -> EpisodeLine:
    """Return the line of an episode, in the list that was asked for."""
    return EpisodeLine(
        row=row,
        address=make_episode_address(row.campaign, row.index, asked),
        badge=make_outcome_badge(row.outcome, is_unresolved=row.assessed.unresolved),
        conflict=describe_conflict(row),
        cells=tuple(format_cell(row, each.name) for each in FIGURES),
    )


def describe_conflict(row: EpisodeRow) -> str:
    """Return the conflict class if it says more than the outcome."""
    known = row.assessed.conflict
    # A safe episode has no conflict, and an old one no class: the outcome says enough.
    words = "" if known in {None, ConflictClass.NONE} else str(known).replace("_", " ")
    return row.assessed.beside(words)


def format_cell(row: EpisodeRow, column: str) -> str:
    """Return a figure of an episode as text."""
    value = filters.read_value(row, column)
    if isinstance(value, int):
        return str(value)
    return format_number(value if isinstance(value, float) else None)


def make_address(
    campaign: int, conditions: str, sort: str = "index", after: int | None = None
) -> str:
    """Return the address of a list of episodes."""
    asked = {"filter": conditions, "sort": sort, "after": after}
    usual = {"filter": "", "sort": "index", "after": None}
    # Addresses are shared by people: what is usual is left out of them.
    given = {name: value for name, value in asked.items() if value != usual[name]}
    path = f"/campaigns/{campaign}/episodes"
    return f"{path}?{urlencode(given)}" if given else path


def make_episode_address(campaign: int, index: int, asked: EpisodeRequest | None = None) -> str:
    """Return the address of an episode's page, with the list that it was reached from, if any."""
    path = f"/campaigns/{campaign}/episodes/{index}"
    if asked is None:
        return path
    return f"{path}?{urlencode({'filter': asked.filter, 'sort': str(asked.sort)})}"


def find_worst_order(spec: CampaignSpec) -> str:
    """Return the order that has the worst failures of a campaign first."""
    # A violation without a collision has no severity.
    return "robustness_m" if spec.named_requirements else "-severity"


def make_headings(
    spec: CampaignSpec, find_address: Callable[[str], str], now: filters.SortOrder | None
) -> tuple[Heading, ...]:
    """Return the column heads; the head that sorts the list links to the reverse order.

    The robustness of a function does not have a unit.

    Args:
        spec: spec of the campaign.
        find_address: returns the address of the list in an order, written as text.
        now: its present order; None if no column sorts it.
    """
    # Robustness has the unit of its world; all others have theirs everywhere.
    units = {"robustness_m": find_robustness_unit(spec)}
    shown = (each._replace(unit=units.get(each.name, each.unit)) for each in FIGURES)
    return tuple(make_heading(each, now, lambda sort: find_address(str(sort))) for each in shown)


def make_heading(
    shown: SortedColumn,
    now: filters.SortOrder | None,
    find_address: Callable[[filters.SortOrder], str],
) -> Heading:
    """Return the head of a column: it offers the more interesting end first, then the reverse."""
    offered = filters.SortOrder(shown.name, shown.largest_first)
    if offered == now:
        offered = filters.SortOrder(shown.name, not shown.largest_first)
    return Heading(
        column=shown,
        address=find_address(offered),
        order=order(now) if now and now.column == shown.name else "",
    )


def order(sort: filters.SortOrder) -> str:
    """Return an order in the words of aria-sort."""
    return "descending" if sort.descending else "ascending"


EXAMPLES = {
    "outcome = collision and severity > 80": "hard collisions",
    "class = planner_failure and ttc_lead_s > 1": "avoidable by braking in time",
    "class = near_miss and source != prior": "near misses of the search",
    "outcome = errored": "episodes that errored",
    "mode = 1": "failures of mode 1 of the newest analysis",
}


def make_found_view(
    campaign: Campaign, asked: EpisodeRequest, page: Page[EpisodeRow]
) -> dict[str, object]:
    """Return what the page shows of the results of a search for episodes."""
    here, conditions, sort = campaign.id, asked.filter, str(asked.sort)
    return make_blank_view(campaign, asked) | {
        "title": make_title(page, asked),
        "exports": list_exports(here, asked),
        "headings": make_headings(
            campaign.spec, partial(make_address, here, conditions), asked.sort
        ),
        "lines": tuple(make_episode_line(row, asked) for row in page.items),
        "first": "" if asked.after is None else make_address(here, conditions, sort),
        "next": "" if page.next is None else make_address(here, conditions, sort, page.next),
        "empty": explain_empty_list(campaign, asked),
    }


def make_blank_view(campaign: Campaign, asked: EpisodeRequest) -> dict[str, object]:
    """Return what the page shows without a search; a filter that is refused has none."""
    return {
        "campaign": campaign,
        "filter": asked.filter,
        "sort": str(asked.sort),
        "sorted": f"{asked.sort.column}, {order(asked.sort)}",
        "longest": filters.LONGEST,
        "examples": [
            (text, make_address(campaign.id, text), words) for text, words in EXAMPLES.items()
        ],
        "columns": tuple(filters.COLUMNS.values()),
        "title": "Episodes",
        "lines": (),
        "first": "",
        "empty": "The filter is invalid: no episodes were searched.",
    }


def make_title(page: Page[EpisodeRow], asked: EpisodeRequest) -> str:
    """Return the number of episodes shown, and whether these are all."""
    shown = len(page.items)
    if page.next is None and asked.after is None:
        return count_noun(shown, "episode")
    if asked.after is not None:
        return count_noun(shown, "further episode")
    return f"The first {shown} episodes"


def explain_empty_list(campaign: Campaign, asked: EpisodeRequest) -> str:
    """Return the reason why the list is empty."""
    if asked.after is not None:
        return "There are no further episodes."
    if asked.filter:
        return "No episodes match this filter."
    return "No episode has ended yet." if may_grow(campaign) else "No episode was run."


def list_exports(campaign: int, asked: EpisodeRequest) -> tuple[tuple[str, str], ...]:
    """Return links to the same episodes as files."""
    query = urlencode({"filter": asked.filter, "sort": str(asked.sort)})
    path = f"{PREFIX}/campaigns/{campaign}/episodes"
    # If a download is refused, the browser does not show the reason. So the link is left out.
    words = ("CSV", "NDJSON", "Parquet") if has_pyarrow() else ("CSV", "NDJSON")
    return tuple((word, f"{path}.{word.lower()}?{query}") for word in words)


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

FAILURES_ON_A_PAGE = 25
EPISODES_ON_A_PAGE = 50

After = Annotated[int | None, Query(ge=0, le=LARGEST)]
Filter = Annotated[str, Query(alias="filter")]


async def parse_request(
    conditions: Filter = "",
    sort: str = str(filters.BY_INDEX),
    after: After = None,
) -> EpisodeRequest:
    """Return the list of episodes that an address requests; the filter is parsed later."""
    return EpisodeRequest(conditions.strip(), filters.parse_sort(sort), after)


@router.get("/campaigns/{campaign}/episodes")
def show_episodes(
    store: Stored,
    campaign: CampaignId,
    asked: Annotated[EpisodeRequest, Depends(parse_request)],
) -> HTMLResponse:
    """Show the episodes that match a filter, in an order, with charts of their measures."""
    seen, after = store.campaigns.get(campaign), asked.after
    try:
        where = filters.parse_filter(asked.filter)
    except InputError as error:
        # The page keeps what was typed, so that it can be mended.
        blank = make_blank_view(seen, asked)
        return page("episodes.html", blank, error.http_status, chart=None, problem=str(error))
    listed = store.episodes.page(campaign, EPISODES_ON_A_PAGE, after, where, asked.sort)
    drawn = spread(store, seen, where)
    unit = find_robustness_unit(seen.spec)
    chart = make_parallel_chart(drawn.rows, unit, is_all=drawn.is_all) if drawn.rows else None
    found = make_found_view(seen, asked, listed)
    return page("episodes.html", found, chart=chart, problem="")


@router.get("/campaigns/{campaign}/failures")
def show_failures(
    store: Stored, campaign: CampaignId, sort: str = str(filters.BY_INDEX), after: After = None
) -> HTMLResponse:
    """Show rows of the list of failures, as a piece of a page."""
    seen, order = store.campaigns.get(campaign), filters.parse_sort(sort)
    view = make_episode_list(seen, read_failures(store, seen, order, after), order, after)
    return page("failures.html", view)


def read_failures(
    store: Store,
    campaign: Campaign,
    sort: filters.SortOrder,
    after: int | None = None,
) -> Page[EpisodeRow]:
    """Return the next page of the list of failures."""
    wanted = filters.parse_filter(filters.write_failure_filter(campaign.spec))
    return store.episodes.page(campaign.id, FAILURES_ON_A_PAGE, after, wanted, sort)
