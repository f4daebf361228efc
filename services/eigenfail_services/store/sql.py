"""The store in a SQL database."""

from sqlalchemy import select

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
from eigenfail_services.store import analyses, campaigns
from eigenfail_services.store.access import SqlAuditLog, SqlKeys
from eigenfail_services.store.analyses import SqlAnalyses
from eigenfail_services.store.campaigns import SqlCampaigns
from eigenfail_services.store.checkpoints import SqlCheckpoints
from eigenfail_services.store.engine import Database
from eigenfail_services.store.episodes import SqlEpisodes
from eigenfail_services.store.events import SqlEventLog
from eigenfail_services.store.figures import SqlFigures
from eigenfail_services.store.jobs import SqlJobQueue
from eigenfail_services.store.remembered import Remembered
from eigenfail_services.store.retention import SqlRetention
from eigenfail_services.store.roster import SqlRoster
from eigenfail_services.store.schema import event_counter


class SqlStore:
    """All parts of the store on one database; safe to use from many threads."""

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

    def __init__(self, database: Database) -> None:
        self._database = database
        self.campaigns = SqlCampaigns(database)
        remembered = Remembered(database)
        self.episodes = SqlEpisodes(database, remembered)
        self.figures = SqlFigures(database, remembered)
        self.checkpoints = SqlCheckpoints(database)
        self.analyses = SqlAnalyses(database)
        self.retention = SqlRetention(database)
        self.events = SqlEventLog(database)
        self.jobs = SqlJobQueue(
            database,
            {JobKind.CAMPAIGN: campaigns.give_up, JobKind.ANALYSIS: analyses.give_up},
        )
        self.keys = SqlKeys(database)
        self.audit = SqlAuditLog(database)
        self.roster = SqlRoster(database)

    def ping(self) -> None:
        """Raises StoreUnavailable, within seconds, if the database does not answer.

        Also if a process, this one or another, could not write to it in the last five seconds.
        """
        with self._database.reading() as connection:
            # SQLite answers SELECT 1 without a look at its file.
            connection.execute(select(event_counter.c.last)).scalar_one()
            self._database.ask_writers(connection)

    def close(self) -> None:
        """Let go of all connections."""
        self._database.close()
