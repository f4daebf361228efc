"""Routes of events: pages, and a stream that clients resume where it was cut."""

from collections import deque
from collections.abc import AsyncIterator
from time import monotonic
from typing import Annotated

from anyio import Lock, sleep
from anyio.to_thread import run_sync
from fastapi import APIRouter, Depends, Header, Query, Request
from fastapi.sse import EventSourceResponse, ServerSentEvent

from eigenfail.values.operations import Event
from eigenfail.values.records import Page
from eigenfail.wire import http
from eigenfail_api.openapi import document_route, document_stream
from eigenfail_api.parameters import LARGEST, Json, Limit, Stored
from eigenfail_services.store.store import Store

BATCH = 500
MOST_KEPT = 2_000
"""Number of the newest events in memory."""


class EventFeed:
    """Feed of the event log: one poll of the store serves any number of followers.

    A follower who resumes before the events in memory reads the log first.

    Args:
        store: store of the event log.
        poll_s: least time between two polls. [s]
    """

    def __init__(self, store: Store, poll_s: float) -> None:
        self._store = store
        self._poll_s = poll_s
        self._closed = False
        self._lock = Lock()
        self._polled_s = float("-inf")
        self._newest: int | None = None
        self._known_from = 0
        self._kept: deque[Event] = deque()

    def close(self) -> None:
        """End all streams: the server is about to stop."""
        self._closed = True

    async def newest(self) -> int:
        """Return the id of the newest event as of the last poll."""
        # All followers that ask at this moment wait for one poll.
        async with self._lock:
            if monotonic() - self._polled_s >= self._poll_s:
                await self._poll()
                self._polled_s = monotonic()
        return self._newest or 0

    async def follow(self, after: int, campaign: int | None) -> AsyncIterator[Event]:
        """Yield events behind an id, then new ones until the feed is closed."""
        while not self._closed:
            newest = await self.newest()
            while after < newest and not self._closed:
                events = await self._behind(after, campaign)
                for event in events:
                    yield event
                seen = events[-1].id if events else after
                # A batch that is not full holds all events up to `newest` that the follower wants.
                after = seen if len(events) == BATCH else max(seen, newest)
            await sleep(self._poll_s)

    async def _poll(self) -> None:
        if self._newest is None:
            # Older events are not loaded into memory: perhaps nobody asks for them.
            self._known_from = self._newest = await run_sync(self._store.events.last)
            return
        events = await run_sync(self._store.events.after, self._newest, BATCH)
        self._kept.extend(events)
        if events:
            self._newest = events[-1].id
        while len(self._kept) > MOST_KEPT:
            self._known_from = self._kept.popleft().id

    async def _behind(self, after: int, campaign: int | None) -> list[Event]:
        """Return at most `BATCH` events behind an id: from memory, if it goes back so far."""
        if after < self._known_from:
            return await run_sync(self._store.events.after, after, BATCH, campaign)
        kept = (each for each in self._kept if each.id > after)
        wanted = [each for each in kept if campaign in {None, each.campaign}]
        return wanted[:BATCH]


router = APIRouter(prefix=http.PREFIX, tags=["events"])

# A browser waits this long before it resumes a stream that was cut.
RETRY_MS = 1000

CampaignFilter = Annotated[
    int | None, Query(ge=1, le=LARGEST, description="Only events of this campaign.")
]
After = Annotated[
    int | None,
    Query(
        ge=0,
        le=LARGEST,
        description="Start after this event; 0 starts with the oldest. Default: new events only.",
    ),
]
Behind = Annotated[
    int, Query(ge=0, le=LARGEST, description="Only events after this one (`next` of a page).")
]
LastEventId = Annotated[
    int | None,
    Header(
        alias="Last-Event-ID",
        ge=0,
        le=LARGEST,
        description="Id of the last event received; overrides `after`.",
    ),
]


async def feed_of(request: Request) -> EventFeed:
    """Return the application's feed."""
    feed: EventFeed = request.app.state.feed
    return feed


def check_campaign_filter(store: Stored, campaign: CampaignFilter = None) -> int | None:
    """Check that a campaign exists before its stream begins; return its id.

    Raises:
        NotFound: it does not.
    """
    return None if campaign is None else store.campaigns.get(campaign).id


@router.get("/events/list", **document_route(Page[Event]))
def list_events(
    store: Stored,
    campaign: Annotated[int | None, Depends(check_campaign_filter)],
    limit: Limit = 100,
    after: Behind = 0,
) -> Json:
    """List events, oldest first; pass `next` of a page as `after`."""
    events = tuple(store.events.after(after, limit, campaign))
    return Json(Page(events, events[-1].id if len(events) == limit else None))


@router.get("/events", response_class=EventSourceResponse, **document_stream())
async def follow_events(
    feed: Annotated[EventFeed, Depends(feed_of)],
    campaign: Annotated[int | None, Depends(check_campaign_filter)],
    after: After = None,
    last_event_id: LastEventId = None,
) -> AsyncIterator[ServerSentEvent]:
    """Stream events as they happen; each has an Event as data, and an id to resume from."""
    asked = after if last_event_id is None else last_event_id
    begin = await feed.newest() if asked is None else asked
    # An id without data: a client that is cut off before the first event resumes here.
    yield ServerSentEvent(id=str(begin), retry=RETRY_MS)
    async for event in feed.follow(begin, campaign):
        yield ServerSentEvent(raw_data=http.encode(event).decode(), id=str(event.id))
