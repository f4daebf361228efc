"""Results on their way to the store, and the fingerprints of the code that they come from.

The hub makes the result of an episode during which several workers were lost.
"""

import time
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence

import msgspec
import structlog

from eigenfail.errors import NotFound, StoreUnavailable
from eigenfail.values.episode import EpisodeFault, EpisodeResult, EpisodeTask, unrunnable
from eigenfail.values.records import Delivery, Verdict
from eigenfail.versions import CODE, select_code
from eigenfail_services.hub.leases import Leases
from eigenfail_services.hub.metrics import Metrics, observe_duration
from eigenfail_services.observability import span
from eigenfail_services.store.campaigns import CampaignStore
from eigenfail_services.store.episodes import EpisodeStore

# Results that come within this time share a transaction. The last ones of a round wait for no
# others: `Hub._has_last_results`.
MAX_WAIT_S = 0.05

MAX_RESULTS = 1_000

# A store that is away is tried once a second, not at each of the hub's turns.
RETRY_S = 1.0

HUB = b"hub"
"""Stands for the worker of results that the hub makes itself."""

MAX_DEATHS = 3

log = structlog.get_logger()


class JudgedResult(msgspec.Struct, frozen=True, eq=False):
    """A result that the store has judged, so that its worker may forget it."""

    worker: bytes
    campaign: int
    result: EpisodeResult
    verdict: Verdict


class _PendingResult(msgspec.Struct, frozen=True, eq=False):
    worker: bytes
    campaign: int
    delivery: Delivery
    arrived_s: float


class CommitQueue:
    """Collects results for up to 50 ms or 1,000 of them, then writes them together.

    Args:
        episodes: the store that they are written to.
        metrics: count the verdicts and measure the durations.
        meanwhile: runs again and again while results are committed, and may add others.

    Attributes:
        stuck: whether results wait because the store could not take them at the last attempt.
    """

    def __init__(
        self,
        episodes: EpisodeStore,
        metrics: Metrics | None = None,
        meanwhile: Callable[[], None] = lambda: None,
    ) -> None:
        self.stuck = False
        self._episodes = episodes
        self._metrics = metrics or Metrics()
        self._meanwhile = meanwhile
        self._pending: list[_PendingResult] = []
        self._due_s = 0.0

    def add(self, worker: bytes, name: str, campaign: int, result: EpisodeResult) -> None:
        """Add a result that a worker brought."""
        now_s = time.monotonic()
        if not self._pending:
            self._due_s = max(self._due_s, now_s + MAX_WAIT_S)
        self._pending.append(_PendingResult(worker, campaign, Delivery(result, name), now_s))

    def campaigns(self) -> set[int]:
        """Return the campaigns of the results that wait."""
        return {pending.campaign for pending in self._pending}

    def flush(self, *, now: bool = False) -> list[JudgedResult]:
        """Write the results that are due, and return the store's verdicts.

        While the store is unavailable, all results wait and are tried again.

        Args:
            now: whether to write all results, due or not.

        Raises:
            StoreUnavailable: nothing was written.
        """
        due = time.monotonic() >= self._due_s or len(self._pending) >= MAX_RESULTS
        if not self._pending or not (due or now):
            return []
        by_campaign: defaultdict[int, list[_PendingResult]] = defaultdict(list)
        # While some are committed, workers bring the next: of all at once, none would be left to
        # run while the learner waits for the end of its round.
        count = len(self._pending) if now else MAX_RESULTS
        for pending in self._pending[:count]:
            by_campaign[pending.campaign].append(pending)
        groups, self._pending, self.stuck = list(by_campaign.values()), self._pending[count:], False
        judged: list[JudgedResult] = []
        while groups:
            try:
                judged += self._commit(groups[0])
            # The groups before this one are in the store. Their verdicts are returned, so that
            # workers may forget those results; the next call meets the failure again and raises
            # it.
            except StoreUnavailable:
                # Behind them are those that came during the attempt.
                self._pending[:0] = [each for group in groups for each in group]
                self.stuck = True
                self._due_s = time.monotonic() + RETRY_S
                if not judged:
                    raise
                break
            del groups[0]
        return judged

    def _commit(self, group: list[_PendingResult]) -> list[JudgedResult]:
        verdicts = self._judge(group[0].campaign, [pending.delivery for pending in group])
        self._record(group, verdicts)
        return [
            JudgedResult(pending.worker, pending.campaign, pending.delivery.result, verdict)
            for pending, verdict in zip(group, verdicts, strict=True)
        ]

    def _judge(self, campaign: int, deliveries: list[Delivery]) -> Sequence[Verdict]:
        with span("commit", campaign=campaign, results=len(deliveries)):
            try:
                with observe_duration(self._metrics.commit_s):
                    return self._episodes.commit(campaign, deliveries, self._meanwhile)
            except NotFound:  # the worker came here from another service
                return [Verdict.UNWANTED] * len(deliveries)

    def _record(self, group: list[_PendingResult], verdicts: Sequence[Verdict]) -> None:
        now_s = time.monotonic()
        for verdict, count in Counter(verdicts).items():
            self._metrics.results.labels(verdict).inc(count)
        self._metrics.result_s.observe([now_s - pending.arrived_s for pending in group])
        walls_s = [pending.delivery.result.believed_wall_s for pending in group]
        self._metrics.episode_s.observe([wall_s for wall_s in walls_s if wall_s])
        for pending in group:
            result = pending.delivery.result
            if result.fault:
                log.warning(
                    "episode errored",
                    campaign=pending.campaign,
                    episode=result.index,
                    worker=pending.delivery.worker,
                    kind=result.fault.kind,
                )


class WorkerDeaths:
    """Counts, in the store, the workers that were lost while they ran an episode.

    The store outlives this hub. After `MAX_DEATHS` of them the hub itself makes the result of the
    episode, which is errored.
    """

    def __init__(self, leases: Leases, commits: CommitQueue, episodes: EpisodeStore) -> None:
        self._leases = leases
        self._commits = commits
        self._episodes = episodes

    def record(self) -> None:
        """Count the deaths since the last call, after which their episodes can be leased again.

        Raises:
            StoreUnavailable: a death could not be counted; the next call tries again.
        """
        for campaign, task in self._leases.list_interrupted():
            if self._add_death(campaign, task) < MAX_DEATHS:
                self._leases.clear_interrupted(campaign, task.index)
            else:
                self._give_up(campaign, task)

    def _add_death(self, campaign: int, task: EpisodeTask) -> int:
        try:
            return self._episodes.add_death(campaign, task.index)
        except NotFound:  # the campaign was removed
            # The hub then makes a result that nobody wants, and the episode is leased no more.
            return MAX_DEATHS

    def _give_up(self, campaign: int, task: EpisodeTask) -> None:
        problem = f"{MAX_DEATHS} workers were lost while they ran it."
        result = unrunnable(task, EpisodeFault("infrastructure", problem))
        self._leases.record_result(campaign, task.index, result.wall_s, HUB)
        self._commits.add(HUB, HUB.decode(), campaign, result)


class CodeRecorder:
    """Records the fingerprints of the code of the workers that a campaign's episodes are leased to.

    Args:
        campaigns: store that the fingerprints are written to.
    """

    def __init__(self, campaigns: CampaignStore) -> None:
        self._campaigns = campaigns
        self._pending: dict[tuple[int, frozenset[tuple[str, str]]], None] = {}
        self._written: set[tuple[int, frozenset[tuple[str, str]]]] = set()

    def note(self, campaign: int, versions: Mapping[str, str]) -> None:
        """Note the versions of a worker that gets episodes of a campaign."""
        code = frozenset(item for item in versions.items() if item[0].startswith(CODE))
        if code and (campaign, code) not in self._written:
            self._pending[campaign, code] = None

    def write(self) -> None:
        """Write the fingerprints that were noted since the last call.

        Raises:
            StoreUnavailable: the next call tries again.
        """
        while self._pending:
            campaign, noted = key = next(iter(self._pending))
            self._write_code(campaign, dict(noted))
            self._written.add(key)
            # Only now, as the store may have been away.
            del self._pending[key]

    def _write_code(self, campaign: int, versions: Mapping[str, str]) -> None:
        try:
            spec = self._campaigns.get(campaign).spec
        except NotFound:
            return
        if code := select_code(versions, spec):
            self._campaigns.add_code(campaign, code)

    def forget(self, campaign: int) -> None:
        """Forget the fingerprints of a campaign that has ended."""
        self._written = {key for key in self._written if key[0] != campaign}
