"""The addresses of lists of episodes."""

from typing import Annotated

from fastapi import APIRouter, Query
from fastapi.responses import HTMLResponse

from eigenfail.contracts import Store
from eigenfail.errors import InputError
from eigenfail.filters import BY_INDEX, outcome_is, parse_filter, parse_sort
from eigenfail.values import Outcome, Page
from eigenfail.values.records import EpisodeRow
from eigenfail_api.dashboard.rendering import page
from eigenfail_api.dashboard.samples import spread
from eigenfail_api.dashboard.views.found import Asked, found_view, refused_view
from eigenfail_api.dashboard.views.lists import episode_list
from eigenfail_api.dashboard.views.parallel import parallel_chart
from eigenfail_api.parameters import LARGEST, CampaignId, Stored

router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

FAILURES = outcome_is(Outcome.COLLISION)
FAILURES_ON_A_PAGE = 25
EPISODES_ON_A_PAGE = 50

After = Annotated[int | None, Query(ge=0, le=LARGEST)]
Filter = Annotated[str, Query(alias="filter")]


@router.get("/campaigns/{campaign}/episodes")
def show_episodes(
    store: Stored,
    campaign: CampaignId,
    conditions: Filter = "",
    sort: str = str(BY_INDEX),
    after: After = None,
) -> HTMLResponse:
    """Episodes that fulfil a filter, sorted, and all of their measures at once."""
    seen = store.campaigns.get(campaign)
    asked = Asked(conditions.strip(), parse_sort(sort), after)
    try:
        where = parse_filter(asked.filter)
    except InputError as error:
        return page("episodes.html", refused_view(seen, asked, str(error)), error.http_status)
    listed = store.episodes.page(campaign, EPISODES_ON_A_PAGE, after, where, asked.sort)
    drawn = spread(store, seen, where)
    chart = parallel_chart(drawn.rows, is_all=drawn.is_all) if drawn.rows else None
    return page("episodes.html", found_view(seen, asked, listed, chart))


@router.get("/campaigns/{campaign}/failures")
def show_failures(store: Stored, campaign: CampaignId, after: After = None) -> HTMLResponse:
    """Rows of the list of failures: a piece of a page."""
    seen = store.campaigns.get(campaign)
    view = episode_list(seen, failures_of(store, campaign, after), after)
    return page("failures.html", view)


def failures_of(store: Store, campaign: int, after: int | None) -> Page[EpisodeRow]:
    """The next failures of the list."""
    return store.episodes.page(campaign, FAILURES_ON_A_PAGE, after, FAILURES)
