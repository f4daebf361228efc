"""The event log for any number of followers, at the price of one."""

from collections import deque
from collections.abc import AsyncIterator
from time import monotonic

from anyio import Lock, sleep
from anyio.to_thread import run_sync

from eigenfail.contracts import Store
from eigenfail.values import Event

BATCH = 500
KEPT = 2_000
"""How many of the newest events are handed out without asking for them again."""


class Feed:
    """Looks at the log for all followers together, and hands each what it has not seen.

    Whoever resumes from before the events that are kept is brought up to them from the log.

    Args:
        store: with the log.
        poll_s: the least time between two looks.
    """

    def __init__(self, store: Store, poll_s: float) -> None:
        self._store = store
        self._poll_s = poll_s
        self._closed = False
        self._looking = Lock()
        self._looked_s = float("-inf")
        self._newest: int | None = None
        self._known_from = 0
        self._kept: deque[Event] = deque()

    def close(self) -> None:
        """Let all followers go: the server is about to stop."""
        self._closed = True

    async def newest(self) -> int:
        """The id of the newest event, as of the last look."""
        async with self._looking:
            if monotonic() - self._looked_s >= self._poll_s:
                await self._look()
                self._looked_s = monotonic()
        return self._newest or 0

    async def follow(self, after: int, campaign: int | None) -> AsyncIterator[Event]:
        """Events behind an id, and those to come, until the feed is closed."""
        while not self._closed:
            newest = await self.newest()
            while after < newest and not self._closed:
                events = await self._behind(after, campaign)
                for event in events:
                    yield event
                seen = events[-1].id if events else after
                after = seen if len(events) == BATCH else max(seen, newest)
            await sleep(self._poll_s)

    async def _look(self) -> None:
        """Take in what is new: one question, whoever follows."""
        if self._newest is None:
            self._known_from = self._newest = await run_sync(self._store.events.last)
            return
        events = await run_sync(self._store.events.after, self._newest, BATCH)
        self._kept.extend(events)
        if events:
            self._newest = events[-1].id
        while len(self._kept) > KEPT:
            self._known_from = self._kept.popleft().id

    async def _behind(self, after: int, campaign: int | None) -> list[Event]:
        """At most `BATCH` events behind an id: from memory, if it goes back so far."""
        if after < self._known_from:
            return await run_sync(self._store.events.after, after, BATCH, campaign)
        kept = (each for each in self._kept if each.id > after)
        wanted = [each for each in kept if campaign in {None, each.campaign}]
        return wanted[:BATCH]
