"""Prometheus metrics of a hub, and the demand for workers.

Each part counts its own events. The hub's thread publishes its status from time to time, so that a
scrape never reads data that the thread is changing.
"""

import time
from bisect import bisect_left
from collections import Counter as Tally
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import StrEnum
from functools import partial
from itertools import accumulate
from threading import Lock
from typing import TYPE_CHECKING, Protocol

import msgspec
from prometheus_client import CollectorRegistry, Counter, Histogram
from prometheus_client.core import GaugeMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.registry import Collector
from prometheus_client.utils import floatToGoString

from eigenfail.values.campaign import Overhead
from eigenfail.values.records import Verdict
from eigenfail_services.hub.learner_link import FailureKind

if TYPE_CHECKING:  # the process of Ray's driver does without the store, which that module imports
    from eigenfail_services.hub.worker_table import WorkerSession

SHORT_S = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5)
"""Buckets for the hub's own operations. [s]"""


LONG_S = (0.01, 0.05, 0.1, 0.5, 1, 5, 10, 30, 60, 300, 900, 3_600)
"""Buckets for episodes and steps of learners. [s]"""


class Work(msgspec.Struct, frozen=True):
    """Work that waits or is leased.

    Attributes:
        episodes: number of proposed episodes without a result.
        worker_s: estimated time that one worker would need for them. [s]
    """

    episodes: int = 0
    worker_s: float = 0.0


class WorkerDemand(msgspec.Struct, frozen=True):
    """Work and workers at one moment.

    Attributes:
        present: names of the connected workers.
        idle: names of the workers that hold no episode.
    """

    work: Work = Work()
    present: frozenset[str] = frozenset()
    idle: frozenset[str] = frozenset()


class CampaignLoad(msgspec.Struct, frozen=True):
    """Load of a running campaign.

    Attributes:
        waiting: number of episodes that wait for a worker.
        leased: number of episodes that workers hold.
        learner_s: how long its learner has been at its current step, 0 while it waits. [s]
    """

    waiting: int = 0
    leased: int = 0
    learner_s: float = 0.0


class HubStatus(msgspec.Struct, frozen=True):
    """Status of a hub: the load of each running campaign, and the number of connected workers."""

    campaigns: Mapping[int, CampaignLoad] = {}
    workers: int = 0


class RunningCampaign(Protocol):
    """The facts of a running campaign that metrics need."""

    def work(self) -> Work:
        """Return the work that waits or is leased."""

    @property
    def learner_s(self) -> float:
        """How long its learner has been at its current step. [s]"""


class DurationHistogram(Collector):
    """Histogram of durations that are observed many at a time.

    A commit observes two durations of each of up to a thousand results. `Histogram` takes one at a
    time and a lock for each, which took a fortieth of the hub's time. Only one thread may observe.

    Args:
        name: name of the metric.
        words: its description.
        bounds_s: upper bounds of its buckets but the last, which has none. [s]
    """

    def __init__(self, name: str, words: str, bounds_s: tuple[float, ...]) -> None:
        self._name, self._words, self._bounds_s = name, words, bounds_s
        # Replaced as a whole, so that a scrape in another thread finds counts and sum that agree.
        self._observed: tuple[list[int], float] = ([0] * (len(bounds_s) + 1), 0.0)

    def observe(self, durations_s: Sequence[float]) -> None:
        """Add some durations."""
        counts, sum_s = self._observed
        added = Tally(map(partial(bisect_left, self._bounds_s), durations_s))
        self._observed = (
            [count + added[bucket] for bucket, count in enumerate(counts)],
            sum_s + sum(durations_s),
        )

    def collect(self) -> Iterator[Metric]:
        """Yield the histogram."""
        counts, sum_s = self._observed
        bounds = [*map(floatToGoString, (*self._bounds_s, float("inf")))]
        buckets = [*zip(bounds, accumulate(counts), strict=True)]
        yield HistogramMetricFamily(self._name, self._words, buckets, sum_s)


class Metrics(Collector):
    """The metrics of one hub.

    Attributes:
        status: the last published status.
    """

    def __init__(self, registry: CollectorRegistry | None = None) -> None:
        self.status = HubStatus()
        self.registry = registry or CollectorRegistry()
        self.results = self._counter("results", "Results that were judged", "verdict")
        self.workers_lost = self._counter("workers_lost", "Workers lost after missed heartbeats")
        self.leases_expired = self._counter("leases_expired", "Leases lost after missed heartbeats")
        self.learners_lost = self._counter("learners_lost", "Learners that were lost", "kind")
        self.commit_s = self._histogram("commit_seconds", "Transactions of results", SHORT_S)
        self.result_s = self._durations(
            "result_seconds", "Results, from their arrival to the end of their commit", SHORT_S
        )
        self.turn_s = self._histogram("hub_turn_seconds", "Turns of the hub", SHORT_S)
        self.episode_s = self._durations("episode_seconds", "Episodes, at their workers", LONG_S)
        self.learner_s = self._histogram("learner_step_seconds", "Steps of learners", LONG_S)
        self.registry.register(self)
        # A series that begins with 1 shows no increase: an alert would miss its first event.
        for verdict in Verdict:
            self.results.labels(verdict)
        for kind in FailureKind:
            self.learners_lost.labels(kind)

    def _counter(self, name: str, words: str, *labels: str) -> Counter:
        return Counter(f"eigenfail_{name}", words, labels, registry=self.registry)

    def _histogram(self, name: str, words: str, buckets: tuple[float, ...]) -> Histogram:
        return Histogram(f"eigenfail_{name}", words, buckets=buckets, registry=self.registry)

    def _durations(self, name: str, words: str, bounds_s: tuple[float, ...]) -> DurationHistogram:
        made = DurationHistogram(f"eigenfail_{name}", words, bounds_s)
        self.registry.register(made)
        return made

    def collect(self) -> Iterator[Metric]:
        """Yield the gauges of the published status."""
        status = self.status
        yield GaugeMetricFamily(
            "eigenfail_workers", "Workers that are connected", value=status.workers
        )
        for field, name, words in (
            ("waiting", "episodes_waiting", "Episodes of running campaigns that no worker holds"),
            ("leased", "episodes_leased", "Episodes of running campaigns that workers have"),
            ("learner_s", "learner_busy_seconds", "For how long a learner has been learning"),
        ):
            family = GaugeMetricFamily(f"eigenfail_{name}", words, labels=["campaign"])
            for campaign, load in status.campaigns.items():
                family.add_metric([str(campaign)], getattr(load, field))
            yield family


def summarize_status(
    campaigns: Mapping[int, RunningCampaign], sessions: "Collection[WorkerSession]"
) -> HubStatus:
    """Return the status of a hub from its running campaigns and worker sessions."""
    leased = Tally(campaign for session in sessions for campaign, _ in session.held)
    loads = {
        campaign: CampaignLoad(
            max(0, each.work().episodes - leased[campaign]), leased[campaign], each.learner_s
        )
        for campaign, each in campaigns.items()
    }
    return HubStatus(loads, len(sessions))


def measure_demand(
    campaigns: Iterable[RunningCampaign], sessions: "Sequence[WorkerSession]"
) -> WorkerDemand:
    """Return the work of running campaigns, and the workers of the given sessions."""
    works = [campaign.work() for campaign in campaigns]
    busy = {session.name for session in sessions if session.held}
    present = frozenset(session.name for session in sessions)
    total = Work(sum(work.episodes for work in works), sum(work.worker_s for work in works))
    return WorkerDemand(total, present, present - busy)


@contextmanager
def observe_duration(histogram: Histogram) -> Iterator[None]:
    """Observe the duration of a block, unless it raises an error."""
    began_s = time.perf_counter()
    yield
    histogram.observe(time.perf_counter() - began_s)


MAX_COUNTED_GAP_S = 1.0
"""Time between two looks that a timeout counts at most: a process that did not look for longer was
stopped, or waited for the database."""


class CampaignPhase(StrEnum):
    """Activity of a campaign: `simulating` as long as a worker holds any of its episodes."""

    SIMULATING = "simulating"
    LEARNING = "learning"
    WAITING = "waiting"


class TimeAccounting:
    """Adds up the time of a campaign by phase.

    The hub sets the phase in its thread; the supervisor takes the sums in another one.

    Args:
        clock: monotonic time. [s]
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = Lock()
        self._phase: CampaignPhase | None = None
        self._since_s = 0.0
        self._spent_s = dict.fromkeys(CampaignPhase, 0.0)
        self._discarded_s = 0.0

    def set_phase(self, phase: CampaignPhase | None) -> None:
        """Set the current phase; None when the hub is done with the campaign."""
        with self._lock:
            # First, as the time until now belongs to the phase that ends.
            self._add_elapsed()
            self._phase = phase

    def add_discarded(self, worker_s: float) -> None:
        """Add the worker time of a result that was not kept. [s]"""
        with self._lock:
            self._discarded_s += worker_s

    def take(self) -> Overhead:
        """Return the sums since the last call, and begin new ones."""
        with self._lock:
            self._add_elapsed()
            taken = Overhead(
                self._spent_s[CampaignPhase.LEARNING],
                self._spent_s[CampaignPhase.WAITING],
                self._discarded_s,
            )
            self._spent_s = dict.fromkeys(CampaignPhase, 0.0)
            self._discarded_s = 0.0
        return taken

    def give_back(self, taken: Overhead) -> None:
        """Add sums that could not be stored, for the next call of `take`."""
        with self._lock:
            self._spent_s[CampaignPhase.LEARNING] += taken.learning_s
            self._spent_s[CampaignPhase.WAITING] += taken.waiting_s
            self._discarded_s += taken.discarded_s

    def _add_elapsed(self) -> None:
        now_s = self._clock()
        if self._phase is not None:
            self._spent_s[self._phase] += now_s - self._since_s
        self._since_s = now_s


class Timeout:
    """Expires after a time that counts only while this process runs.

    Args:
        limit_s: time until it expires. [s]
        clock: monotonic time. [s]
    """

    def __init__(self, limit_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._limit_s = limit_s
        self._clock = clock
        self.restart()

    def restart(self, pause_s: float = 0.0) -> None:
        """Start counting from zero, now or after a pause."""
        self._spent_s = -pause_s
        self._looked_s = self._clock()

    def has_expired(self) -> bool:
        """Count the time since the last call; return whether the limit is exceeded."""
        now_s = self._clock()
        # A process that did not look was stopped itself: that is not its learner's fault.
        self._spent_s += min(now_s - self._looked_s, MAX_COUNTED_GAP_S)
        self._looked_s = now_s
        return self._spent_s > self._limit_s
