"""Group commit: many results in one transaction, acknowledged only when it has happened."""

import time
from collections import Counter, defaultdict
from collections.abc import Sequence
from math import inf

import msgspec
import structlog

from eigenfail.contracts import EpisodeStore
from eigenfail.errors import NotFound, StoreUnavailable
from eigenfail.values import EpisodeResult
from eigenfail.values.records import Delivery, Verdict
from eigenfail_services.hub.vitals import Vitals, timed
from eigenfail_services.tracing import span

MAX_WAIT_S = 0.05
MAX_RESULTS = 256
RETRY_S = 1.0

log = structlog.get_logger()


class Committed(msgspec.Struct, frozen=True, eq=False):
    """A result that the store has judged; the worker may forget it."""

    worker: bytes
    campaign: int
    result: EpisodeResult
    verdict: Verdict


class Pending(msgspec.Struct, frozen=True, eq=False):
    """A result that waits for the next commit."""

    worker: bytes
    campaign: int
    delivery: Delivery
    came_s: float


class Commits:
    """Collects results for up to 50 ms or 256 of them, then writes them together.

    Args:
        episodes: where they are written.
        vitals: where it is counted what became of them, and how long it took.

    Attributes:
        stuck: whether results wait that the store did not take when it was last asked to.
    """

    def __init__(self, episodes: EpisodeStore, vitals: Vitals | None = None) -> None:
        self.stuck = False
        self._episodes = episodes
        self._vitals = vitals or Vitals()
        self._pending: list[Pending] = []
        self._due_s = 0.0

    def add(self, worker: bytes, name: str, campaign: int, result: EpisodeResult) -> None:
        """Take a result from a worker."""
        now_s = time.monotonic()
        if not self._pending:
            self._due_s = max(self._due_s, now_s + MAX_WAIT_S)
        self._pending.append(Pending(worker, campaign, Delivery(result, name), now_s))

    def campaigns(self) -> set[int]:
        """Those of which results wait."""
        return {pending.campaign for pending in self._pending}

    def flush(self, *, now: bool = False) -> list[Committed]:
        """Write what is due, or everything; what became of it.

        While the store is unavailable everything stays pending and is tried again.

        Raises:
            StoreUnavailable: nothing was written.
        """
        due = time.monotonic() >= self._due_s or len(self._pending) >= MAX_RESULTS
        if not self._pending or not (due or now):
            return []
        groups, self._pending, self.stuck = self._by_campaign(), [], False
        committed: list[Committed] = []
        while groups:
            try:
                committed += self._commit(groups[0])
            except StoreUnavailable:
                self._postpone(groups)
                if not committed:
                    raise
                break
            del groups[0]
        return committed

    def _postpone(self, groups: list[list[Pending]]) -> None:
        self._pending, self.stuck = [pending for group in groups for pending in group], True
        self._due_s = time.monotonic() + RETRY_S

    def _by_campaign(self) -> list[list[Pending]]:
        groups: defaultdict[int, list[Pending]] = defaultdict(list)
        for pending in self._pending:
            groups[pending.campaign].append(pending)
        return list(groups.values())

    def _commit(self, group: list[Pending]) -> list[Committed]:
        verdicts = self._judged(group[0].campaign, [pending.delivery for pending in group])
        self._count(group, verdicts)
        return [
            Committed(pending.worker, pending.campaign, pending.delivery.result, verdict)
            for pending, verdict in zip(group, verdicts, strict=True)
        ]

    def _judged(self, campaign: int, deliveries: list[Delivery]) -> Sequence[Verdict]:
        with span("commit", campaign=campaign, results=len(deliveries)):
            try:
                with timed(self._vitals.commit_s):
                    return self._episodes.commit(campaign, deliveries)
            except NotFound:  # brought by a worker that came here from another service
                return [Verdict.UNWANTED] * len(deliveries)

    def _count(self, group: list[Pending], verdicts: Sequence[Verdict]) -> None:
        vitals, now_s = self._vitals, time.monotonic()
        for verdict, number in Counter(verdicts).items():
            vitals.results.labels(verdict).inc(number)
        for pending in group:
            vitals.result_s.observe(now_s - pending.came_s)
            result = pending.delivery.result
            if 0.0 < result.wall_s < inf:  # it came over the wire
                vitals.episode_s.observe(result.wall_s)
            if result.fault:
                log.warning(
                    "episode failed",
                    campaign=pending.campaign,
                    episode=result.index,
                    worker=pending.delivery.worker,
                    kind=result.fault.kind,
                )
