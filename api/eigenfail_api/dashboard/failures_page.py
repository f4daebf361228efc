"""The page of the failures of all campaigns."""

from collections.abc import Mapping
from typing import Annotated, NamedTuple
from urllib.parse import urlencode

from fastapi import APIRouter, Depends, Query
from fastapi.responses import HTMLResponse

from eigenfail.errors import InvalidValue
from eigenfail.filters import SortOrder, parse_sort, write_failure_filter
from eigenfail.values.campaign import Campaign
from eigenfail.values.failures import MOST_SEVERE_FIRST, FailureFilter, parse_failure_sort
from eigenfail.values.records import EpisodeRow, Page
from eigenfail_api.dashboard import episodes_page
from eigenfail_api.dashboard.rendering import page
from eigenfail_api.parameters import Stored
from eigenfail_api.routes.failures import After, parse_failures
from eigenfail_services.store.store import Store

router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

FAILURES_ON_A_PAGE = 50
PATH = "/failures"

Words = Annotated[str, Query(max_length=200)]


class FailureQuery(NamedTuple):
    """The query in an address of the page; an empty text is not a condition.

    Attributes:
        query: the parameters that are not empty, as in the address, without the place.
        where: the same as a filter.
        sort: the order, written as text.
    """

    query: Mapping[str, str]
    where: FailureFilter
    sort: str


class FailureForm(NamedTuple):
    """Fields of the form, as in the address. An empty field filters nothing."""

    project: Words = ""
    planner: Words = ""
    planner_version: Words = ""
    method: Words = ""


def parse_request(
    campaigns: Annotated[FailureForm, Depends()],
    archived: Annotated[bool, Query()] = False,
    sort: Annotated[str, Query(max_length=64)] = MOST_SEVERE_FIRST,
) -> FailureQuery:
    """Return the query for failures that an address describes."""
    # Parsed only to refuse a wrong order before anything is read.
    parse_failure_sort(sort)
    of_campaign = {name: text.strip() for name, text in campaigns._asdict().items()}
    given = {
        **of_campaign,
        "archived": "true" if archived else "",
        "sort": "" if sort.strip() == MOST_SEVERE_FIRST else sort.strip(),
    }
    # The same as in the API, so that the copied request lists the same failures.
    where = parse_failures(**of_campaign, archived=archived)
    return FailureQuery({name: text for name, text in given.items() if text}, where, sort.strip())


@router.get(PATH)
def show_failures(
    store: Stored,
    asked: Annotated[FailureQuery, Depends(parse_request)],
    after: After = None,
) -> HTMLResponse:
    """Show the collisions of all campaigns by severity."""
    descending = parse_failure_sort(asked.sort)
    found, is_gone = _read_page(store, asked, after, most_severe_first=descending)
    after = None if is_gone else after
    campaigns = store.failures.read_campaigns(found.items)
    return page(
        "all_failures.html",
        [(row, campaigns[row.campaign].spec, _write_place(row, campaigns)) for row in found.items],
        query=asked.query,
        severity=episodes_page.make_heading(
            episodes_page.SortedColumn("severity", "Severity", "m²/s²", is_minor=False),
            SortOrder("severity", descending),
            lambda sort: _write_address(asked.query, sort=str(sort)),
        ),
        describe=episodes_page.describe_conflict,
        cell=episodes_page.format_cell,
        first="" if after is None else _write_address(asked.query),
        next="" if found.next is None else _write_address(asked.query, after=str(found.next)),
        archive=_describe_archive(asked),
        copied=f"/failures?{urlencode(asked.query)}" if asked.query else "/failures",
        is_first_again=is_gone,
        is_filtered=bool({*asked.query} - {"sort", "archived"}),
    )


def _read_page(
    store: Store, asked: FailureQuery, after: int | None, *, most_severe_first: bool
) -> tuple[Page[EpisodeRow], bool]:
    """Return a page of failures, and whether it is the first one for lack of that place."""

    def read(place: int | None) -> Page[EpisodeRow]:
        return store.failures.page(
            asked.where, FAILURES_ON_A_PAGE, place, most_severe_first=most_severe_first
        )

    try:
        return read(after), False
    except InvalidValue as error:
        # Other fields are wrong in themselves; a place goes when its failure is deleted.
        if error.field != "after":
            raise
        return read(None), True


def _write_place(row: EpisodeRow, campaigns: Mapping[int, Campaign]) -> str:
    """Return the address of an episode in the list of failures of its campaign."""
    spec = campaigns[row.campaign].spec
    sort = parse_sort(episodes_page.find_worst_order(spec))
    listed = episodes_page.EpisodeRequest(write_failure_filter(spec), sort)
    return episodes_page.make_episode_address(row.campaign, row.index, listed)


def _describe_archive(asked: FailureQuery) -> tuple[str, str]:
    if "archived" in asked.query:
        return "Hide failures of archived campaigns", _write_address(asked.query, archived="")
    return "Show failures of archived campaigns", _write_address(asked.query, archived="true")


def _write_address(query: Mapping[str, str], **changes: str) -> str:
    given = {name: text for name, text in {**query, **changes}.items() if text}
    return f"{PATH}?{urlencode(given)}" if given else PATH
