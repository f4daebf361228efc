"""The page of all campaigns."""

from collections.abc import Sequence
from functools import partial
from typing import Annotated, Literal, NamedTuple
from urllib.parse import urlencode

from fastapi import APIRouter, Depends, Query
from fastapi.responses import HTMLResponse

from eigenfail.filters import NEWEST_FIRST, parse_campaign_sort
from eigenfail.presentation.figures import count_noun
from eigenfail.values.campaign import FINAL_STATES, Campaign, CampaignFilter, CampaignState
from eigenfail.values.operations import ACTIVE_S, Presence, WorkerShare
from eigenfail.values.summary import Summary
from eigenfail_api.dashboard import cost_charts
from eigenfail_api.dashboard.episodes_page import Heading, SortedColumn, make_heading
from eigenfail_api.dashboard.rendering import WORKING, Tile, Tiles, describe_remaining, page
from eigenfail_api.parameters import Before, Stored
from eigenfail_services.campaigns.summary import (
    count_present,
    list_recent_workers,
    list_unrunnable,
    make_staffing,
    summarise_campaigns,
)
from eigenfail_services.comparison.peers import compare_peers, list_methods

MOST_LINES = 100


def make_worker_tiles(
    here: Sequence[Presence], lately: Sequence[WorkerShare], within_s: int
) -> tuple[tuple[str, Tile], ...]:
    """Return the tiles of the connected workers and of their speed over the last seconds."""
    # A worker may have gone since its last result: it counts as one of now all the same.
    at_work = {share.worker for share in lately}
    names = {presence.worker for presence in here} | at_work
    episodes = sum(share.episodes for share in lately)
    window = f"results of the last {within_s} s"
    return (
        ("Workers now", Tile(len(names), (f"{len(at_work)} with {window}",))),
        ("Episodes/s now", Tile(episodes / within_s, (window,))),
    )


LABELS = {
    "project": "project",
    "tag": "tag",
    "planner_version": "planner version",
    "suite": "suite",
}
"""Filters that addresses have, but the form does not, with their words."""

FILTERS = ("state", "method", "search", *LABELS)


# A form sends empty fields, too.
State = Annotated[CampaignState | Literal[""], Query()]
Words = Annotated[str, Query(max_length=200)]
Archived = Annotated[bool, Query()]

Sort = Annotated[str, Query(max_length=64)]


class Wanted(NamedTuple):
    """The filter and order of the list, as its address has them. An empty text is not a condition.

    Attributes:
        method: an empty text leaves out replays, which find nothing new.
        sort: their order, as text.
        project, tag, planner_version, suite: as campaigns state them; only addresses have them.
        archived: whether archived campaigns are listed, too.
    """

    state: State = ""
    method: Words = ""
    search: Words = ""
    before: Before = None
    sort: Sort = str(NEWEST_FIRST)
    project: Words = ""
    tag: Words = ""
    planner_version: Words = ""
    suite: Words = ""
    archived: Archived = False

    def address(self, **changes: object) -> str:
        """Return the address of this page, or of one with changes."""
        given = self._asdict() | changes
        # An address without an order lists the newest first.
        if given["sort"] == str(NEWEST_FIRST):
            del given["sort"]
        if given["archived"]:
            given["archived"] = "true"
        query = {name: str(value) for name, value in given.items() if value}
        return f"/?{urlencode(query)}" if query else "/"

    @property
    def unfiltered(self) -> str:
        """Return the address of all campaigns, in the same order."""
        return self.address(**dict.fromkeys(FILTERS, ""), before=None)

    @property
    def labels(self) -> tuple[tuple[str, str, str], ...]:
        """Return parameter, words and value of each filter that the form does not have."""
        named = ((name, words, getattr(self, name)) for name, words in LABELS.items())
        return tuple(each for each in named if each[2])

    @property
    def where(self) -> CampaignFilter:
        """Return the wanted campaigns as a filter of the store."""
        conditions = {name: getattr(self, name) or None for name in FILTERS}
        # Who asks for replays by name gets them.
        besides = None if self.method else cost_charts.REPLAY
        return CampaignFilter(
            **conditions, besides=besides, archived=None if self.archived else False
        )

    @property
    def is_filtered(self) -> bool:
        """Return whether a filter is set."""
        return any(getattr(self, name) for name in FILTERS)


COLUMNS = (
    SortedColumn("id", "Id"),
    SortedColumn("name", "Campaign", largest_first=False),
    SortedColumn("planner", "Planner", "in scenario", largest_first=False),
    SortedColumn("method", "Method", largest_first=False),
    SortedColumn("state", "State", largest_first=False),
    SortedColumn("failures", "Failures", "rate, interval"),
    SortedColumn("cost_per_failure_usd", "Cost per failure", "n, interval", largest_first=False),
)


def make_campaign_headings(wanted: Wanted) -> tuple[Heading, ...]:
    """Return the heads of the columns that sort the list; the present one links to its reverse."""
    now = parse_campaign_sort(wanted.sort)
    return tuple(
        make_heading(each, now, lambda sort: wanted.address(before=None, sort=str(sort)))
        for each in COLUMNS
    )


def describe_archive(wanted: Wanted) -> tuple[str, str]:
    """Return words and address of the same list with archived campaigns, or without them."""
    words = "Hide archived campaigns" if wanted.archived else "Show archived campaigns"
    return words, wanted.address(archived=not wanted.archived, before=None)


def fold_replays(count: int, wanted: Wanted) -> tuple[str, str] | None:
    """Return the number of hidden replays that match the filters, and the address of their list."""
    if wanted.method or not count:
        return None
    among = "matches among " if wanted.is_filtered else ""
    words = f"{among}{count_noun(count, 'replay')}"
    return words, wanted.address(method=cost_charts.REPLAY, before=None)


def make_tiles(campaigns: Sequence[Campaign], summaries: Sequence[Summary]) -> Tiles:
    """Return the tiles of sums over the campaigns of the page."""
    running = sum(campaign.state == "running" for campaign in campaigns)
    completed = sum(campaign.counts.completed for campaign in campaigns)
    failures = sum(campaign.counts.failures for campaign in campaigns)
    spent = sum(summary.cost.total_usd for summary in summaries)
    return (
        ("Campaigns", Tile(len(campaigns), (f"{running} running",))),
        ("Episodes", Tile(completed, ("completed",))),
        ("Failures", Tile(failures, ("collisions or violations",))),
        ("Spent", Tile(spent, ("instance-hours × price",), unit="USD")),
    )


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

CAMPAIGNS_ON_A_PAGE = 50


@router.get("/")
def show_overview(store: Stored, asked: Annotated[Wanted, Depends()]) -> HTMLResponse:
    """Show campaigns in an order, by default newest first."""
    order = parse_campaign_sort(asked.sort)
    wanted = asked._replace(search=asked.search.strip(), sort=str(order))
    # The feed goes on behind this event: it is read first, so that no event falls between.
    latest, pools = store.events.last(), store.figures.pools()
    found = store.campaigns.page(CAMPAIGNS_ON_A_PAGE, wanted.before, wanted.where, order)
    summaries = summarise_campaigns(store, found.items)
    replays = sum(pool.campaigns for pool in pools if pool.method == cost_charts.REPLAY)
    here, stranded = count_present(store), list_unrunnable(store)
    has_archive = bool(store.campaigns.page(1, where=CampaignFilter(archived=True)).items)
    method_charts, method_notes = cost_charts.make_method_costs(compare_peers(pools))
    view = {
        "wanted": wanted,
        "headings": make_campaign_headings(wanted),
        "newest": wanted.address(before=None) if wanted.before else None,
        "older": wanted.address(before=found.next) if found.next else None,
        "states": tuple(CampaignState),
        "methods": list_methods(pools),
        "any_method": f"any except {cost_charts.REPLAY}" if replays else "any",
        "replays": fold_replays(replays, wanted),
        "lines": [
            (each, summary, describe_remaining(each, summary))
            for each, summary in zip(found.items, summaries, strict=True)
        ],
        "open": [each.id for each in found.items if each.state not in FINAL_STATES],
        "tiles": (
            *make_tiles(found.items, summaries),
            *make_worker_tiles(here, list_recent_workers(store, ACTIVE_S), ACTIVE_S),
        ),
        "method_charts": method_charts,
        "method_notes": method_notes,
        "costs": cost_charts.make_cost_chart(summaries),
        "wants_workers": not here and any(each.state in WORKING for each in found.items),
        "stranded": stranded,
        "latest": latest,
        "archive": describe_archive(wanted) if has_archive else None,
    }
    # The template calls this only if no worker is connected: it reads the newest events.
    staffing = partial(make_staffing, store, len(here), stranded)
    return page("overview.html", view, staffing=staffing)
