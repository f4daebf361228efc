"""What Prometheus may scrape: the campaigns of the store and the requests of this process."""

from collections import Counter as Tally
from collections import defaultdict
from collections.abc import Iterator, Mapping

from prometheus_client import CollectorRegistry, Counter
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from eigenfail.contracts import Store
from eigenfail.values import Campaign, CampaignState
from eigenfail_services.campaigns.summary import campaign_cost

METHODS = frozenset({"GET", "POST", "HEAD", "OPTIONS", "PUT", "PATCH", "DELETE"})
PAGE = 500


class Campaigns(Collector):
    """Counts over all campaigns, taken from the store at every scrape."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def collect(self) -> Iterator[Metric]:
        """The figures of this moment."""
        states, ends = Tally[str](dict.fromkeys(CampaignState, 0)), Tally[str]()
        failures = Tally[str]()
        hours, usd = defaultdict[str, float](float), defaultdict[str, float](float)
        for campaign in every_campaign(self._store):
            counts, method = campaign.counts, campaign.spec.method
            states[campaign.state] += 1
            ends.update(completed=counts.completed, failed=counts.failed)
            failures[method] += counts.failures
            bill = campaign_cost(campaign)
            hours[method] += bill.instance_hours
            usd[method] += bill.total_usd
        yield filled(GaugeMetricFamily, "campaigns", "Campaigns by state", "state", states)
        yield filled(CounterMetricFamily, "episodes", "Episodes that are over", "end", ends)
        yield filled(CounterMetricFamily, "failures", "Collisions found", "method", failures)
        yield filled(CounterMetricFamily, "instance_hours", "Instance-hours", "method", hours)
        yield filled(CounterMetricFamily, "cost_usd", "What they cost", "method", usd)


def filled(
    kind: type[GaugeMetricFamily] | type[CounterMetricFamily],
    name: str,
    words: str,
    label: str,
    values: Mapping[str, float],
) -> Metric:
    """A family of figures, one for each value of its label."""
    family = kind(f"eigenfail_{name}", words, labels=[label])
    for value, number in values.items():
        family.add_metric([value], number)
    return family


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
