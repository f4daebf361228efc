"""What remembers: ids and frozen values in and out, each verb one transaction."""

from typing import Protocol

from eigenfail.contracts.access import AuditLog, KeyStore
from eigenfail.contracts.analyses import AnalysisStore
from eigenfail.contracts.campaigns import CampaignStore
from eigenfail.contracts.checkpoints import CheckpointStore
from eigenfail.contracts.episodes import EpisodeStore
from eigenfail.contracts.events import EventLog
from eigenfail.contracts.figures import FigureStore
from eigenfail.contracts.jobs import JobQueue
from eigenfail.contracts.retention import RetentionStore
from eigenfail.contracts.roster import Roster


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
