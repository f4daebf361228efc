"""The job queue in SQL: a row for each piece of work, leased to whoever claims it."""

from collections.abc import Callable, Mapping
from uuid import uuid4

from sqlalchemy import (
    ColumnElement,
    Connection,
    Table,
    bindparam,
    case,
    delete,
    func,
    insert,
    not_,
    select,
    true,
    update,
)

from eigenfail.values import Priority
from eigenfail.values.records import Job, JobKind
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.engine import Database
from eigenfail_services.store.leases import LEASE_OVER, held, leased
from eigenfail_services.store.limits import BURIED, MAX_ATTEMPTS
from eigenfail_services.store.schema import analyses, campaigns, jobs

SUBJECTS: Mapping[JobKind, Table] = {JobKind.CAMPAIGN: campaigns, JobKind.ANALYSIS: analyses}

NOT_BURIED = jobs.c.buried_because.is_(None)
# Asked all the time, so made once: building a statement costs more than running it.
WAITING = (
    select(func.count())
    .select_from(jobs)
    .where(jobs.c.kind == bindparam("wanted"), NOT_BURIED, LEASE_OVER)
)
LEASED = select(jobs.c.owner, jobs.c.token).where(
    jobs.c.token.is_not(None), NOT_BURIED, not_(LEASE_OVER)
)

Undertaker = Callable[[Connection, int, str], object]


def enqueue(connection: Connection, kind: JobKind, subject: int) -> None:
    """A job at the end of the queue; one that was left over is taken from whoever holds it."""
    withdraw(connection, kind, subject)
    connection.execute(
        insert(jobs).values(
            kind=kind,
            subject=subject,
            queued_ms=now_ms(),
            lease_until_ms=0,
            lease_ms=0,
            attempts=0,
            progress=0,
        )
    )


def withdraw(connection: Connection, kind: JobKind, subject: int) -> None:
    """Take the job for a subject out of the queue, whoever holds it."""
    connection.execute(delete(jobs).where(jobs.c.kind == kind, jobs.c.subject == subject))


class SqlJobQueue:
    """Claims, leases and burials.

    Attempts count the claims since the work last got further: a campaign that keeps results is
    never buried, however often its supervisor is lost.

    Args:
        database: where the queue is.
        undertakers: what makes a subject of each kind fail, given its id and the reason.
    """

    def __init__(self, database: Database, undertakers: Mapping[JobKind, Undertaker]) -> None:
        self._database = database
        self._undertakers = undertakers

    def claim(self, owner: str, lease_s: float, kind: JobKind | None = None) -> Job | None:
        """The next job (of a kind) that nobody works on, now leased to the owner."""
        while (job := self._take(owner, lease_s, kind)) and job.attempts > MAX_ATTEMPTS:
            self._bury(job)
        return job

    def _take(self, owner: str, lease_s: float, kind: JobKind | None) -> Job | None:
        first = (
            select(jobs.c.id)
            .where(free(kind))
            .order_by(place(), jobs.c.id)
            .limit(1)
            .with_for_update(skip_locked=True)
        )
        progress = finished()
        statement = (
            update(jobs)
            .where(jobs.c.id == first.scalar_subquery())
            .values(
                owner=owner,
                token=uuid4().hex,
                **leased(lease_s),
                attempts=case((progress > jobs.c.progress, 1), else_=jobs.c.attempts + 1),
                progress=progress,
            )
            .returning(jobs.c.id, jobs.c.kind, jobs.c.subject, jobs.c.token, jobs.c.attempts)
        )
        with self._database.writing() as connection:
            found = connection.execute(statement).one_or_none()
        return None if found is None else Job(found.id, JobKind(found.kind), *found[2:])

    def _bury(self, job: Job) -> None:
        table = SUBJECTS[job.kind]
        # Everybody locks the subject first and its job second.
        lock = select(table.c.id).where(table.c.id == job.subject).with_for_update(key_share=True)
        grave = update(jobs).where(held(job)).values(token=None, buried_because=BURIED)
        with self._database.writing() as connection:
            connection.execute(lock)
            if connection.execute(grave).rowcount:
                self._undertakers[job.kind](connection, job.subject, BURIED)

    def renew(self, job: Job, lease_s: float) -> bool:
        """Hold the job longer, or, with 0, give it back; False if it is no longer ours."""
        statement = update(jobs).where(held(job)).values(**leased(lease_s))
        with self._database.writing() as connection:
            return connection.execute(statement).rowcount == 1

    def let_go(self, is_lost: Callable[[str], bool]) -> int:
        """Free at once what is leased to owners that are lost; how many jobs that are."""
        with self._database.reading() as connection:
            found = connection.execute(LEASED).all()
        lost = [row.token for row in found if is_lost(row.owner)]
        if not lost:
            return 0
        free_now = update(jobs).where(jobs.c.token.in_(lost)).values(**leased(0.0))
        with self._database.writing() as connection:
            return connection.execute(free_now).rowcount

    def finish(self, job: Job) -> bool:
        """The job is done; False if it was no longer ours."""
        with self._database.writing() as connection:
            return connection.execute(delete(jobs).where(held(job))).rowcount == 1

    def waiting(self, kind: JobKind) -> int:
        """How many jobs of a kind wait to be claimed."""
        with self._database.reading() as connection:
            return connection.execute(WAITING, {"wanted": kind}).scalar_one()


def free(kind: JobKind | None) -> ColumnElement[bool]:
    """Jobs (of a kind) that nobody holds."""
    wanted = true() if kind is None else jobs.c.kind == kind
    return wanted & NOT_BURIED & LEASE_OVER


def place() -> ColumnElement[int]:
    """Where a job stands in the queue: by when it was queued, less what its priority is worth."""
    starts = {priority.value: priority.head_start_ms for priority in Priority}
    head_start = (
        select(case(starts, value=campaigns.c.priority))
        .where(campaigns.c.id == jobs.c.subject, jobs.c.kind == JobKind.CAMPAIGN)
        .scalar_subquery()
    )
    return jobs.c.queued_ms - func.coalesce(head_start, Priority.NORMAL.head_start_ms)


def finished() -> ColumnElement[int]:
    """How many episodes the campaign of a job has behind it; 0 for other jobs."""
    count = (
        select(campaigns.c.completed + campaigns.c.failed)
        .where(campaigns.c.id == jobs.c.subject, jobs.c.kind == JobKind.CAMPAIGN)
        .scalar_subquery()
    )
    return func.coalesce(count, 0)
