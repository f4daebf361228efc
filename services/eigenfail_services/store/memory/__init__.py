"""The store's twin in memory: no file, no driver, gone with the process."""

from eigenfail.contracts import (
    AnalysisStore,
    CampaignStore,
    CheckpointStore,
    EpisodeStore,
    EventLog,
    JobQueue,
)
from eigenfail.values.records import JobKind
from eigenfail_services.store.memory.analyses import MemoryAnalyses
from eigenfail_services.store.memory.campaigns import MemoryCampaigns, MemoryCheckpoints
from eigenfail_services.store.memory.episodes import MemoryEpisodes
from eigenfail_services.store.memory.queue import MemoryJobQueue
from eigenfail_services.store.memory.tables import MemoryEventLog, Tables


class MemoryStore:
    """All parts of the store in this process; safe to use from many threads."""

    campaigns: CampaignStore
    episodes: EpisodeStore
    checkpoints: CheckpointStore
    analyses: AnalysisStore
    events: EventLog
    jobs: JobQueue

    def __init__(self) -> None:
        tables = Tables()
        campaigns, analyses = MemoryCampaigns(tables), MemoryAnalyses(tables)
        self.campaigns = campaigns
        self.episodes = MemoryEpisodes(tables)
        self.checkpoints = MemoryCheckpoints(tables)
        self.analyses = analyses
        self.events = MemoryEventLog(tables)
        self.jobs = MemoryJobQueue(
            tables, {JobKind.CAMPAIGN: campaigns.give_up, JobKind.ANALYSIS: analyses.fail}
        )

    def ping(self) -> None:
        """It always answers."""

    def close(self) -> None:
        """There is nothing to let go of."""
