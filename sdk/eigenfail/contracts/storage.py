"""What remembers: ids and frozen values in and out, each verb one transaction."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Protocol

from eigenfail.contracts.access import AuditLog, KeyStore
from eigenfail.contracts.retention import RetentionStore
from eigenfail.contracts.roster import Roster
from eigenfail.filters import BY_INDEX, Conditions, Sort
from eigenfail.values import (
    Analysis,
    AnalysisResult,
    AnalysisSettings,
    BlockTotals,
    Campaign,
    CampaignSpec,
    CampaignState,
    EpisodeResult,
    Estimate,
    Event,
    Overhead,
    Page,
    PairTotals,
    Priority,
    SafetyTotals,
    SpendingTotals,
    Trials,
)
from eigenfail.values.campaign_filter import ANY_CAMPAIGN, CampaignFilter
from eigenfail.values.pool import Pool
from eigenfail.values.records import (
    Delivery,
    EpisodeRow,
    Failures,
    Job,
    JobKind,
    Totals,
    Verdict,
)
from eigenfail.values.region import MOST_TRIALS
from eigenfail.values.safety import MOST_POINTS
from eigenfail.values.sample import MOST_SAMPLES, EpisodeSample
from eigenfail.values.spending import MOST_LANDINGS
from eigenfail.values.suite import SuiteStanding
from eigenfail.values.worker import WorkerShare

NOTHING = Overhead()


class CampaignStore(Protocol):
    """Campaigns and their life."""

    def create(
        self, spec: CampaignSpec, idempotency_key: str | None = None, made_by: int | None = None
    ) -> Campaign:
        """A new campaign, queued with a job for it; the same one again for the same key.

        Args:
            spec: what is asked for.
            idempotency_key: what tells this request from others, for ever.
            made_by: id of the key of whoever asks; what counts against its quotas.

        Raises:
            IdempotencyMismatch: the key was used for another spec, whatever its priority.
            QuotaExceeded: the key of whoever asks does not allow more.
        """

    def create_many(
        self,
        specs: Sequence[CampaignSpec],
        idempotency_key: str | None = None,
        made_by: int | None = None,
    ) -> tuple[Campaign, ...]:
        """New campaigns in this order, all of them or none; the same ones again for the same key.

        Keys of single campaigns are not known here, nor these there.

        Raises:
            IdempotencyMismatch: the key was used for another list of specs; none is new.
            QuotaExceeded: the key of whoever asks does not allow all of them; none is new.
        """

    def prioritise(self, campaign: int, priority: Priority) -> Campaign:
        """Give it another priority from now on, and log the event; the same again is no event.

        Raises:
            NotFound: no such campaign.
            IllegalTransition: it has ended.
        """

    def get(self, campaign: int) -> Campaign:
        """The campaign as it stands.

        Raises:
            NotFound: no such campaign.
        """

    def page(
        self,
        limit: int,
        before: int | None = None,
        state: CampaignState | None = None,
        suite: str | None = None,
        where: CampaignFilter = ANY_CAMPAIGN,
    ) -> Page[Campaign]:
        """Campaigns, newest first, with ids below `before`; of one state, of one suite."""

    def suites(self, limit: int, before: int | None = None) -> Page[SuiteStanding]:
        """Suites by their newest campaigns, newest first, of those with ids below `before`."""

    def move(
        self, campaign: int, to: CampaignState, because: str = "", claim: Job | None = None
    ) -> Campaign:
        """Change the state, and log the event.

        A move to `queued` queues a job; a move to a final state counts what is still open as
        cancelled and, for `done`, stores the digest.

        Args:
            campaign: by its id.
            to: the new state.
            because: why, in a sentence.
            claim: of who runs the campaign; users need none.

        Raises:
            NotFound: no such campaign.
            IllegalTransition: its state does not allow it.
            ClaimLost: the claim is no longer the campaign's; nothing changes.
        """

    def add_active(
        self,
        campaign: int,
        seconds: float,
        overhead: Overhead = NOTHING,
        claim: Job | None = None,
    ) -> None:
        """Add to the time during which the campaign was running, and to what that went into.

        The overhead of a campaign of which an older release did not measure it stays unknown.

        Raises:
            NotFound: no such campaign.
            ClaimLost: the claim is no longer the campaign's; nothing is added.
        """


class EpisodeStore(Protocol):
    """Results of episodes: at most one for each, for good."""

    def commit(self, campaign: int, deliveries: Sequence[Delivery]) -> list[Verdict]:
        """Keep results, update the counts, and log alarms; one verdict for each delivery."""

    def add_death(self, campaign: int, index: int) -> int:
        """One more worker was lost while it ran this episode; how many that makes.

        Raises:
            NotFound: no such campaign.
        """

    def get(self, campaign: int, index: int) -> EpisodeResult:
        """One result with everything that is kept of it.

        Raises:
            NotFound: no such campaign, or the episode has no result.
            NoisePruned: its noise was taken away.
        """

    def page(
        self,
        campaign: int,
        limit: int,
        after: int | None = None,
        where: Conditions = (),
        sort: Sort = BY_INDEX,
    ) -> Page[EpisodeRow]:
        """Episodes that fulfil all conditions, in an order, behind the index `after` in it.

        By index, `after` may be any number; in another order it is that of an episode with a
        result, behind which rows follow each other without gap or overlap, whatever comes in.
        """

    def finished(self, campaign: int, indices: Iterable[int]) -> list[EpisodeResult]:
        """Those of the episodes that have a result, in index order, without their scenes.

        Raises:
            NoisePruned: the noise of one of them was taken away.
        """

    def failures(self, campaign: int) -> Failures:
        """The noise of all collisions."""

    def failure_portions(self, campaign: int) -> Iterator[Failures]:
        """The same, at most `PORTION` at a time, of one moment: for those who keep less of it."""

    def totals(self, campaign: int) -> Totals:
        """Sums over all collisions, and episodes counted by class, as `assess` classifies them."""

    def course(self, campaign: int, per: int) -> list[BlockTotals]:
        """Sums over blocks of `per` indices, in index order, of those with a completed episode."""

    def safety(self, campaign: int, most: int = MOST_POINTS) -> SafetyTotals:
        """Safety measures over the completed episodes, with at most so many points.

        Where there are more failures with a severity than `most`, the points are every k-th of
        them in index order from the first one on, for the smallest k that is enough.
        """

    def trials(self, campaign: int, most: int = MOST_TRIALS) -> Trials:
        """Seeds and outcomes of the completed episodes in index order.

        Where there are more than `most`, of every k-th from the first one on, for the smallest k
        that is enough.
        """

    def spending(self, campaign: int, most: int = MOST_LANDINGS) -> SpendingTotals:
        """Worker time in the episodes, and when they landed.

        The landings are every k-th completed episode by the time that it was stored, then by
        index, for the smallest k that leaves at most so many; and the last one.
        """

    def paired(self, first: int, second: int) -> PairTotals:
        """The episodes that two campaigns both completed, with one seed and kind of source."""

    def digest(self, campaign: int) -> str:
        """SHA-256 over the digests of all results in index order, one line "index digest" each."""


class FigureStore(Protocol):
    """Sums over campaigns and their episodes, for those who look at much at once.

    Each verb asks a fixed number of questions, however many campaigns there are.
    """

    def totals(self, campaigns: Sequence[int]) -> dict[int, Totals]:
        """What `EpisodeStore.totals` says, of some campaigns by their ids."""

    def samples(self, campaign: int, most: int = MOST_SAMPLES) -> tuple[EpisodeSample, ...]:
        """At most so many of the completed episodes, evenly spread, in index order.

        Those whose index is a multiple of k, for the smallest k that is enough up to the largest
        index that has a result.
        """

    def workers(self, campaign: int) -> tuple[WorkerShare, ...]:
        """Who ran the episodes of a campaign; who ran most comes first, then by name."""

    def workers_since(self, at_ms: int) -> tuple[WorkerShare, ...]:
        """Who brought results since a moment, and of which campaigns; only these are counted."""

    def pools(self) -> tuple[Pool, ...]:
        """All campaigns by what they have in common and by method, the newest first."""


class CheckpointStore(Protocol):
    """The learner's last states of each campaign, and what it then told.

    The one before the last is kept to fall back to, should the last one be damaged.
    """

    def save(
        self,
        campaign: int,
        checkpoint: bytes,
        estimate: Estimate | None = None,
        trained_episodes: int | None = None,
        claim: Job | None = None,
    ) -> None:
        """A new checkpoint, and what the campaign's learner told, all or nothing.

        Args:
            campaign: by its id.
            checkpoint: the learner's state and the open rounds; its SHA-256 is kept with it.
            estimate: of the failure probability.
            trained_episodes: how many it was trained with.
            claim: of who runs the campaign.

        Raises:
            NotFound: no such campaign.
            ClaimLost: the claim is no longer the campaign's; nothing is saved.
        """

    def load(self, campaign: int) -> bytes | None:
        """The newest checkpoint that is whole, if there is one.

        Raises:
            ProtocolError: there are checkpoints, and none is whole.
        """

    def recover(self, campaign: int, claim: Job | None = None) -> bytes | None:
        """The same, to go on from: newer ones that are damaged are dropped, with an event.

        Raises:
            NotFound: no such campaign.
            ClaimLost: the claim is no longer the campaign's.
            ProtocolError: there are checkpoints, and none is whole.
        """


class AnalysisStore(Protocol):
    """Analyses and what they found."""

    def create(self, campaign: int, settings: AnalysisSettings) -> Analysis:
        """A new analysis, queued with a job for it.

        Raises:
            NotFound: no such campaign.
        """

    def get(self, analysis: int) -> Analysis:
        """The analysis as it stands.

        Raises:
            NotFound: no such analysis.
        """

    def page(
        self, limit: int, before: int | None = None, campaign: int | None = None
    ) -> Page[Analysis]:
        """Analyses, newest first, with ids below `before`, without their results."""

    def start(self, analysis: int) -> None:
        """It is running now."""

    def finish(self, analysis: int, result: AnalysisResult) -> None:
        """It is done."""

    def fail(self, analysis: int, problem: str) -> None:
        """It cannot be done."""

    def link_replay(self, analysis: int, campaign: int) -> None:
        """Remember a campaign that replays what it found; nothing new if it is known.

        Raises:
            NotFound: no such analysis or campaign.
        """

    def replays(self, analysis: int) -> tuple[int, ...]:
        """The campaigns that replay what it found, oldest first.

        Raises:
            NotFound: no such analysis.
        """


class EventLog(Protocol):
    """What happened, in order, for whoever follows."""

    def append(self, kind: str, message: str, campaign: int | None = None) -> Event:
        """Log an event."""

    def after(self, event: int, limit: int, campaign: int | None = None) -> list[Event]:
        """Events with ids above `event`, oldest first."""

    def latest(self, limit: int, campaign: int | None = None) -> list[Event]:
        """The newest events, newest first."""

    def last(self) -> int:
        """The id of the newest event, 0 if there is none."""


class JobQueue(Protocol):
    """Work for supervisors: claimed under a lease, back in the queue when the lease runs out."""

    def claim(self, owner: str, lease_s: float, kind: JobKind | None = None) -> Job | None:
        """The next job (of a kind) that nobody works on, now leased to the owner.

        That is the oldest, where each campaign counts as older by its priority's head start.
        A job that was claimed too often is buried with its reason instead, and its subject fails.
        """

    def renew(self, job: Job, lease_s: float) -> bool:
        """Hold the job longer; False if it is no longer ours."""

    def let_go(self, is_lost: Callable[[str], bool]) -> int:
        """Free at once what is leased to owners that are lost; how many jobs that are."""

    def finish(self, job: Job) -> bool:
        """The job is done; False if it was no longer ours."""

    def waiting(self, kind: JobKind) -> int:
        """How many jobs of a kind wait to be claimed."""


class Store(Protocol):
    """All of it."""

    campaigns: CampaignStore
    episodes: EpisodeStore
    figures: FigureStore
    checkpoints: CheckpointStore
    analyses: AnalysisStore
    retention: RetentionStore
    events: EventLog
    jobs: JobQueue
    keys: KeyStore
    audit: AuditLog
    roster: Roster

    def ping(self) -> None:
        """Raises StoreUnavailable, within seconds, if the database does not answer."""

    def close(self) -> None:
        """Let go of all connections."""
