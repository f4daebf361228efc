"""How a hub is doing, as Prometheus may scrape it.

What happens is counted where it happens; how things stand is published by the hub's thread from
time to time, so that a scrape never looks into what that thread is changing.
"""

import time
from collections import Counter as Tally
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from typing import Protocol

import msgspec
from prometheus_client import CollectorRegistry, Counter, Histogram
from prometheus_client.core import GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from eigenfail.values.records import Verdict
from eigenfail_services.hub.losses import Kind
from eigenfail_services.hub.muster import Working
from eigenfail_services.hub.seats import Seat

SHORT_S = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5)
"""Buckets for what a hub does itself. [s]"""

LONG_S = (0.01, 0.05, 0.1, 0.5, 1, 5, 10, 30, 60, 300, 900, 3_600)
"""Buckets for episodes and steps of learners. [s]"""


class Load(msgspec.Struct, frozen=True):
    """How a running campaign stands.

    Attributes:
        waiting: episodes that nobody has.
        leased: episodes that workers have.
        learner_s: for how long its learner has been learning; 0 while it waits. [s]
    """

    waiting: int = 0
    leased: int = 0
    learner_s: float = 0.0


class Standing(msgspec.Struct, frozen=True):
    """How a hub stands: the campaigns that it runs, by number, and the workers that are here."""

    campaigns: Mapping[int, Load] = {}
    workers: int = 0


class Vitals(Collector):
    """The figures of one hub.

    Attributes:
        standing: as of a moment ago.
    """

    def __init__(self, registry: CollectorRegistry | None = None) -> None:
        self.standing = Standing()
        self.registry = registry or CollectorRegistry()
        self.results = self._counter("results", "Results that were judged", "verdict")
        self.workers_lost = self._counter("workers_lost", "Workers that fell silent")
        self.leases_expired = self._counter("leases_expired", "Leases of workers that fell silent")
        self.learners_lost = self._counter("learners_lost", "Learners that were lost", "kind")
        self.commit_s = self._histogram("commit_seconds", "Transactions of results", SHORT_S)
        self.result_s = self._histogram(
            "result_seconds", "Results, from their arrival to the end of their commit", SHORT_S
        )
        self.turn_s = self._histogram("hub_turn_seconds", "Turns of the hub", SHORT_S)
        self.episode_s = self._histogram("episode_seconds", "Episodes, at their workers", LONG_S)
        self.learner_s = self._histogram("learner_step_seconds", "Steps of learners", LONG_S)
        self.registry.register(self)
        # A series that begins with 1 shows no increase: the first alarm would not be seen.
        for verdict in Verdict:
            self.results.labels(verdict)
        for kind in Kind:
            self.learners_lost.labels(kind)

    def _counter(self, name: str, words: str, *labels: str) -> Counter:
        return Counter(f"eigenfail_{name}", words, labels, registry=self.registry)

    def _histogram(self, name: str, words: str, buckets: tuple[float, ...]) -> Histogram:
        return Histogram(f"eigenfail_{name}", words, buckets=buckets, registry=self.registry)

    def collect(self) -> Iterator[Metric]:
        """How things stand."""
        standing = self.standing
        yield GaugeMetricFamily(
            "eigenfail_workers", "Workers that are connected", value=standing.workers
        )
        for field, name, words in (
            ("waiting", "episodes_waiting", "Episodes of running campaigns that nobody has"),
            ("leased", "episodes_leased", "Episodes of running campaigns that workers have"),
            ("learner_s", "learner_busy_seconds", "For how long a learner has been learning"),
        ):
            family = GaugeMetricFamily(f"eigenfail_{name}", words, labels=["campaign"])
            for campaign, load in standing.campaigns.items():
                family.add_metric([str(campaign)], getattr(load, field))
            yield family


class Watched(Working, Protocol):
    """A campaign that runs, with its learner."""

    @property
    def learner_s(self) -> float:
        """For how long its learner has been at its step. [s]"""


def standing(campaigns: Mapping[int, Watched], seats: Collection[Seat]) -> Standing:
    """How it stands with these campaigns and these workers."""
    leased = Tally(campaign for seat in seats for campaign, _ in seat.held)
    loads = {
        campaign: Load(
            max(0, each.work().episodes - leased[campaign]), leased[campaign], each.learner_s
        )
        for campaign, each in campaigns.items()
    }
    return Standing(loads, len(seats))


@contextmanager
def timed(histogram: Histogram) -> Iterator[None]:
    """What the block takes, if it comes to its end."""
    began_s = time.perf_counter()
    yield
    histogram.observe(time.perf_counter() - began_s)
