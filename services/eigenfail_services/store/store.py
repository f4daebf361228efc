"""All parts of the store on one database, and the function that opens it."""

from contextlib import ExitStack
from functools import cache

from eigenfail.values.records import JobKind
from eigenfail_services.store import analyses, campaigns
from eigenfail_services.store.access import AuditLog, KeyStore
from eigenfail_services.store.analyses import AnalysisStore
from eigenfail_services.store.campaigns import CampaignStore
from eigenfail_services.store.checkpoints import CheckpointStore
from eigenfail_services.store.engine import WAIT_S, Database, find_backend, translate_errors
from eigenfail_services.store.episodes import EpisodeStore
from eigenfail_services.store.events import EventLog
from eigenfail_services.store.failures import FailureStore
from eigenfail_services.store.gates import GateStore
from eigenfail_services.store.jobs import JobQueue
from eigenfail_services.store.migrate import ensure_newest, upgrade_with
from eigenfail_services.store.query_cache import AnswerCache, FigureStore
from eigenfail_services.store.retention import RetentionStore
from eigenfail_services.store.roster import Roster
from eigenfail_services.store.sqlite import SqliteMemory

MEMORY = "memory://"


class Store:
    """All parts of the store on one database; safe to use from many threads.

    Attributes:
        database: transactions, for the tables of plug-ins.
    """

    def __init__(self, database: Database) -> None:
        self.database = database
        self.campaigns = CampaignStore(database)
        self.answers = AnswerCache()
        self.episodes = EpisodeStore(database)
        self.failures = FailureStore(database)
        self.figures = FigureStore(database, self.answers)
        self.checkpoints = CheckpointStore(database)
        self.analyses = AnalysisStore(database)
        self.retention = RetentionStore(database)
        self.events = EventLog(database)
        self.jobs = JobQueue(
            database,
            {JobKind.CAMPAIGN: campaigns.give_up, JobKind.ANALYSIS: analyses.give_up},
        )
        self.keys = KeyStore(database)
        self.audit = AuditLog(database)
        self.roster = Roster(database)
        self.gates = GateStore(database)

    def ping(self) -> None:
        """Raise StoreUnavailable, within seconds, if the database does not answer.

        Also if no writer gets its lock, or if a process, this one or another, could not write to
        it in the last five seconds. Nothing is written.
        """
        self.database.probe()

    def close(self) -> None:
        """Close all connections."""
        self.database.close()


def open_store(url: str, *, migrate: bool = True, wait_s: float = WAIT_S) -> Store:
    """Open the store at an address.

    An empty database gets its tables, and an older schema is upgraded: all of the way or not at
    all.

    Args:
        url: sqlite:///folder/file.db, postgresql://user:password@host:5432/database, or memory://
            for one that is gone with the process.
        migrate: whether the schema may be changed; if not, anything but the newest is refused.
        wait_s: how long a statement waits for the lock of another program. [s]

    Raises:
        InvalidValue: it is not the address of a supported database.
        StoreUnavailable: nothing can be read or written there, within about five seconds; or
            there is nothing and it may not be made.
        SchemaMismatch: the schema is newer than this program, of another program, or may not be
            changed.
    """
    if url == MEMORY:
        return Store(Database(SqliteMemory(wait_s, _empty_image())))
    backend = find_backend(url, wait_s)
    if migrate:
        with translate_errors(backend):
            backend.prepare()
    else:
        backend.require()
    database = Database(backend)
    with ExitStack() as undo:
        # A database that is refused must not leave its connections and threads behind.
        undo.callback(database.close)
        ensure_newest(database, backend, migrate=migrate)
        undo.pop_all()
    return Store(database)


@cache
def _empty_image() -> bytes:
    """Return a database with the newest schema and no rows, as bytes.

    It is made once for each process: the migrations take half a second, a copy a millisecond.
    """
    first = SqliteMemory(WAIT_S)
    upgrade_with(first)
    return first.image()
