"""The event log for any number of followers, at the price of one."""

from collections.abc import AsyncIterator
from time import monotonic

from anyio import sleep
from anyio.to_thread import run_sync

from eigenfail.contracts import Store
from eigenfail.values import Event

BATCH = 500


class Feed:
    """Looks at the newest event's id for all followers together.

    Args:
        store: with the log.
        poll_s: the least time between two looks.
    """

    def __init__(self, store: Store, poll_s: float) -> None:
        self._store = store
        self._poll_s = poll_s
        self._closed = False
        self._newest = 0
        self._looked_s = float("-inf")

    def close(self) -> None:
        """Let all followers go: the server is about to stop."""
        self._closed = True

    async def newest(self) -> int:
        """The id of the newest event, as of the last look."""
        if monotonic() - self._looked_s >= self._poll_s:
            # Before the look, so that whoever comes meanwhile does not look as well.
            self._looked_s = monotonic()
            self._newest = await run_sync(self._store.events.last)
        return self._newest

    async def follow(self, after: int, campaign: int | None) -> AsyncIterator[Event]:
        """Events behind an id, and those to come, until the feed is closed."""
        while not self._closed:
            newest = await self.newest()
            while after < newest and not self._closed:
                events = await run_sync(self._store.events.after, after, BATCH, campaign)
                for event in events:
                    yield event
                seen = events[-1].id if events else after
                after = seen if len(events) == BATCH else max(seen, newest)
            await sleep(self._poll_s)
