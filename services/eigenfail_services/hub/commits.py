"""Group commit: many results in one transaction, acknowledged only when it has happened."""

import time
from collections import defaultdict

import msgspec

from eigenfail.contracts import EpisodeStore
from eigenfail.errors import NotFound, StoreUnavailable
from eigenfail.values import EpisodeResult
from eigenfail.values.records import Delivery, Verdict

MAX_WAIT_S = 0.05
MAX_RESULTS = 256
RETRY_S = 1.0


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


class Commits:
    """Collects results for up to 50 ms or 256 of them, then writes them together.

    Attributes:
        stuck: whether results wait that the store did not take when it was last asked to.
    """

    def __init__(self, episodes: EpisodeStore) -> None:
        self.stuck = False
        self._episodes = episodes
        self._pending: list[Pending] = []
        self._due_s = 0.0

    def add(self, worker: bytes, name: str, campaign: int, result: EpisodeResult) -> None:
        """Take a result from a worker."""
        if not self._pending:
            self._due_s = max(self._due_s, time.monotonic() + MAX_WAIT_S)
        self._pending.append(Pending(worker, campaign, Delivery(result, name)))

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
        campaign = group[0].campaign
        try:
            verdicts = self._episodes.commit(campaign, [pending.delivery for pending in group])
        except NotFound:  # brought by a worker that came here from another service
            verdicts = [Verdict.UNWANTED] * len(group)
        return [
            Committed(pending.worker, campaign, pending.delivery.result, verdict)
            for pending, verdict in zip(group, verdicts, strict=True)
        ]
