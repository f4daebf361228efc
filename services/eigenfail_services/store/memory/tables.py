"""What the twin remembers, under one lock, and its event log."""

from collections import Counter
from collections.abc import Collection
from itertools import count
from threading import RLock

import msgspec

from eigenfail.values import Analysis, Campaign, CampaignState, EpisodeResult, Event
from eigenfail.values.access import KeyRecord
from eigenfail.values.records import EpisodeRow, Job, JobKind
from eigenfail.values.retention import Pruning
from eigenfail_services.store import limits
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.refusals import claim_lost, no_analysis, no_campaign


class QueuedJob(msgspec.Struct):
    """A job's row."""

    id: int
    kind: JobKind
    subject: int
    queued_ms: int
    owner: str = ""
    token: str = ""
    lease_until_ms: int = 0
    attempts: int = 0
    progress: int = 0


class KeptCheckpoint(msgspec.Struct):
    """A checkpoint's row."""

    state: bytes
    sha256: str


class Tables:
    """Everything there is. Each verb of the store holds the lock from its first look to its end."""

    def __init__(self) -> None:
        self.lock = RLock()
        self.campaigns: dict[int, Campaign] = {}
        self.keys: dict[str, int] = {}
        self.batches: dict[str, tuple[int, ...]] = {}
        self.made_by: dict[int, int] = {}
        self.records: dict[int, KeyRecord] = {}
        self.episodes: dict[int, dict[int, tuple[EpisodeRow, EpisodeResult]]] = {}
        self.deaths = Counter[tuple[int, int]]()
        self.checkpoints: dict[int, list[KeptCheckpoint]] = {}
        self.analyses: dict[int, Analysis] = {}
        self.replays: dict[int, set[int]] = {}
        self.prunings: dict[int, Pruning] = {}
        self.events: dict[int, Event] = {}
        self.jobs: dict[int, QueuedJob] = {}
        self.job_ids = count(1)
        self.last_event = 0

    def campaign(self, campaign: int) -> Campaign:
        """The campaign of an id, or NotFound."""
        if campaign not in self.campaigns:
            raise no_campaign(campaign)
        return self.campaigns[campaign]

    def analysis(self, analysis: int) -> Analysis:
        """The analysis of an id, or NotFound."""
        if analysis not in self.analyses:
            raise no_analysis(analysis)
        return self.analyses[analysis]

    def log(self, kind: str, message: str, campaign: int | None) -> Event:
        """Append an event, and forget the oldest."""
        self.last_event += 1
        event = Event(self.last_event, now_ms(), kind, message, campaign)
        self.events[event.id] = event
        self.events.pop(event.id - limits.KEPT_EVENTS, None)
        return event

    def enqueue(self, kind: JobKind, subject: int) -> None:
        """A job at the end of the queue; one that was left over is taken from its holder."""
        self.withdraw(kind, subject)
        job = QueuedJob(next(self.job_ids), kind, subject, now_ms())
        self.jobs[job.id] = job

    def held(self, claim: Job) -> QueuedJob | None:
        """The job of a claim as long as the token is its own."""
        found = self.jobs.get(claim.id)
        return found if found is not None and found.token == claim.token else None

    def fence(self, claim: Job | None) -> None:
        """Let only the holder of a claim go on, or ClaimLost; None is whoever needs no claim."""
        if claim is not None and self.held(claim) is None:
            raise claim_lost(claim)

    def withdraw(self, kind: JobKind, subject: int) -> None:
        """Take the job for a subject out of the queue, whoever holds it."""
        self.jobs = {
            number: job
            for number, job in self.jobs.items()
            if (job.kind, job.subject) != (kind, subject)
        }


class MemoryEventLog:
    """What happened, in order."""

    def __init__(self, tables: Tables) -> None:
        self._tables = tables

    def append(self, kind: str, message: str, campaign: int | None = None) -> Event:
        """Log an event."""
        with self._tables.lock:
            return self._tables.log(kind, message, campaign)

    def after(self, event: int, limit: int, campaign: int | None = None) -> list[Event]:
        """Events with ids above `event`, oldest first."""
        with self._tables.lock:
            found = [
                logged
                for number, logged in self._tables.events.items()
                if number > event and campaign in {None, logged.campaign}
            ]
        return found[:limit]

    def latest(self, limit: int, campaign: int | None = None) -> list[Event]:
        """The newest events, newest first."""
        with self._tables.lock:
            newest_first = reversed(self._tables.events.values())
            return [each for each in newest_first if campaign in {None, each.campaign}][:limit]

    def newest(self, kinds: Collection[str]) -> list[Event]:
        """The newest event of these kinds of each campaign that is running, by campaign."""
        with self._tables.lock:
            campaigns = self._tables.campaigns.items()
            running = {number for number, each in campaigns if each.state == CampaignState.RUNNING}
            newest = {
                each.campaign: each
                for each in self._tables.events.values()
                if each.kind in kinds and each.campaign in running
            }
        return [newest[campaign] for campaign in sorted(running & newest.keys())]

    def last(self) -> int:
        """The id of the newest event, 0 if there is none."""
        with self._tables.lock:
            return self._tables.last_event
