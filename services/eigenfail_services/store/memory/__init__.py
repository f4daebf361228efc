"""The store's twin in memory: no file, no driver, gone with the process."""

from eigenfail.contracts import (
    AnalysisStore,
    AuditLog,
    CampaignStore,
    CheckpointStore,
    EpisodeStore,
    EventLog,
    FigureStore,
    JobQueue,
    KeyStore,
    RetentionStore,
    Roster,
)
from eigenfail.values.records import JobKind
from eigenfail_services.store.memory.access import MemoryAuditLog, MemoryKeys
from eigenfail_services.store.memory.analyses import MemoryAnalyses
from eigenfail_services.store.memory.campaigns import MemoryCampaigns
from eigenfail_services.store.memory.checkpoints import MemoryCheckpoints
from eigenfail_services.store.memory.episodes import MemoryEpisodes
from eigenfail_services.store.memory.figures import MemoryFigures
from eigenfail_services.store.memory.queue import MemoryJobQueue
from eigenfail_services.store.memory.retention import MemoryRetention
from eigenfail_services.store.memory.roster import MemoryRoster
from eigenfail_services.store.memory.tables import MemoryEventLog, Tables


class MemoryStore:
    """All parts of the store in this process; safe to use from many threads."""

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

    def __init__(self) -> None:
        tables = Tables()
        campaigns, analyses = MemoryCampaigns(tables), MemoryAnalyses(tables)
        self.campaigns = campaigns
        episodes = MemoryEpisodes(tables)
        self.episodes = episodes
        self.figures = MemoryFigures(tables, episodes)
        self.checkpoints = MemoryCheckpoints(tables)
        self.analyses = analyses
        self.retention = MemoryRetention(tables)
        self.events = MemoryEventLog(tables)
        self.jobs = MemoryJobQueue(
            tables, {JobKind.CAMPAIGN: campaigns.give_up, JobKind.ANALYSIS: analyses.fail}
        )
        self.keys = MemoryKeys(tables)
        self.audit = MemoryAuditLog(tables)
        self.roster = MemoryRoster(tables)

    def ping(self) -> None:
        """It always answers."""

    def close(self) -> None:
        """There is nothing to let go of."""
