"""Events, as a client follows them."""

from collections.abc import Iterator

import httpx2

from eigenfail.client.link import Link
from eigenfail.client.waiting import patience
from eigenfail.values import Event
from eigenfail.wire import http

RECONNECT_S = 0.5
MOST_FAILURES = 5


class Events:
    """Follow what happens."""

    def __init__(self, link: Link) -> None:
        self._link = link

    def follow(self, after: int = 0, campaign: int | None = None) -> Iterator[Event]:
        """Every event from now on without end, through cut connections and restarts.

        Args:
            after: begin behind the event with this id; 0 begins with the oldest one.
            campaign: only events of this campaign.

        Raises:
            NotFound: no such campaign.
            ServiceUnreachable: the service stays away.
        """
        failures = 0
        while True:
            try:
                for event in self._connected(after, campaign):
                    after, failures = event.id, 0
                    yield event
            except httpx2.TransportError as error:
                failures += 1
                if failures == MOST_FAILURES:
                    raise self._link.unreachable(error) from error
            patience.get().rest(RECONNECT_S)

    def _connected(self, after: int, campaign: int | None) -> Iterator[Event]:
        """The events of one connection; those without data only mark a place."""
        place = {"Last-Event-ID": str(after)}
        with self._link.stream("/events", {"campaign": campaign}, place) as events:
            for event in events:
                if event.data:
                    yield http.decode(event.data.encode(), Event)
