"""What happens: as server-sent events that resume where they were cut, and as pages."""

from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Depends, Header, Query, Request
from fastapi.sse import EventSourceResponse, ServerSentEvent

from eigenfail.values import Event, Page
from eigenfail.wire import http
from eigenfail_api.bodies import Json
from eigenfail_api.feed import Feed
from eigenfail_api.parameters import LARGEST, Limit, Stored
from eigenfail_api.schemas import documented, documented_stream

router = APIRouter(prefix=http.PREFIX, tags=["events"])

RETRY_MS = 1000

CampaignFilter = Annotated[
    int | None, Query(ge=1, le=LARGEST, description="Only events of this campaign.")
]
After = Annotated[
    int | None,
    Query(
        ge=0,
        le=LARGEST,
        description="Begin behind this event; 0 begins with the oldest. Without it: from now on.",
    ),
]
Behind = Annotated[
    int, Query(ge=0, le=LARGEST, description="Only those behind this event: `next` of a page.")
]
LastEventId = Annotated[
    int | None,
    Header(
        alias="Last-Event-ID",
        ge=0,
        le=LARGEST,
        description="The last event that was seen; goes before `after`.",
    ),
]


async def feed_of(request: Request) -> Feed:
    """The app's one feed."""
    feed: Feed = request.app.state.feed
    return feed


def known_campaign(store: Stored, campaign: CampaignFilter = None) -> int | None:
    """The campaign to follow, known to exist before the stream begins.

    Raises:
        NotFound: it does not.
    """
    return None if campaign is None else store.campaigns.get(campaign).id


@router.get("/events/list", **documented(Page[Event]))
def list_events(
    store: Stored,
    campaign: Annotated[int | None, Depends(known_campaign)],
    limit: Limit = 100,
    after: Behind = 0,
) -> Json:
    """Events that happened, oldest first: `next` of a page is what `after` takes."""
    events = tuple(store.events.after(after, limit, campaign))
    return Json(Page(events, events[-1].id if len(events) == limit else None))


@router.get("/events", response_class=EventSourceResponse, **documented_stream())
async def follow_events(
    feed: Annotated[Feed, Depends(feed_of)],
    campaign: Annotated[int | None, Depends(known_campaign)],
    after: After = None,
    last_event_id: LastEventId = None,
) -> AsyncIterator[ServerSentEvent]:
    """Events as they happen: the data of each is an Event, its id the place to resume from."""
    asked = after if last_event_id is None else last_event_id
    begin = await feed.newest() if asked is None else asked
    # A place without data: who is cut off before the first event resumes here, not later.
    yield ServerSentEvent(id=str(begin), retry=RETRY_MS)
    async for event in feed.follow(begin, campaign):
        yield ServerSentEvent(raw_data=http.encode(event).decode(), id=str(event.id))
