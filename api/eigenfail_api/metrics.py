"""What Prometheus may scrape: the campaigns of the store and the requests of this process."""

from collections import Counter as Tally
from collections.abc import Iterator

from prometheus_client import CollectorRegistry, Counter
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from eigenfail.contracts import Store
from eigenfail.values import Campaign, CampaignState

METHODS = frozenset({"GET", "POST", "HEAD", "OPTIONS", "PUT", "PATCH", "DELETE"})
PAGE = 500


class Campaigns(Collector):
    """Counts over all campaigns, taken from the store at every scrape."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def collect(self) -> Iterator[Metric]:
        """The figures of this moment."""
        states, episodes = Tally(dict.fromkeys(CampaignState, 0)), Tally[str]()
        for campaign in every_campaign(self._store):
            counts = campaign.counts
            states[campaign.state] += 1
            episodes.update(completed=counts.completed, failed=counts.failed)
            episodes.update(failures=counts.failures)
        by_state = GaugeMetricFamily("eigenfail_campaigns", "Campaigns by state", labels=["state"])
        for state, number in states.items():
            by_state.add_metric([state], number)
        yield by_state
        done = CounterMetricFamily(
            "eigenfail_episodes",
            "Episodes that are over, by whether they could be run",
            labels=["end"],
        )
        done.add_metric(["completed"], episodes["completed"])
        done.add_metric(["failed"], episodes["failed"])
        yield done
        yield CounterMetricFamily(
            "eigenfail_failures", "Collisions found", value=episodes["failures"]
        )


def every_campaign(store: Store) -> Iterator[Campaign]:
    """All campaigns, newest first."""
    before: int | None = None
    while True:
        page = store.campaigns.page(PAGE, before)
        yield from page.items
        if page.next is None:
            return
        before = page.next


class Requests:
    """Middleware: counts requests by method, route and status."""

    def __init__(self, app: ASGIApp, registry: CollectorRegistry) -> None:
        self._app = app
        self._counter = Counter(
            "eigenfail_http_requests",
            "Requests answered",
            ["method", "route", "status"],
            registry=registry,
        )

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on, and count what was answered; a fault of our own is answered outside."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        status = 500

        async def send_and_note(message: Message) -> None:
            nonlocal status
            status = message.get("status", status)
            await send(message)

        try:
            await self._app(scope, receive, send_and_note)
        finally:
            # Whatever a stranger sends ends in one of finitely many series.
            method = scope["method"] if scope["method"] in METHODS else "other"
            route = getattr(scope.get("route"), "path", "none")
            self._counter.labels(method, route, str(status)).inc()
