"""The job queue: a row for each campaign or analysis to be run, leased to who claims it."""

from collections.abc import Callable, Mapping
from typing import Any
from uuid import uuid4

import sqlalchemy as sa

from eigenfail.errors import ClaimLost
from eigenfail.values.campaign_spec import Priority
from eigenfail.values.records import Job, JobKind
from eigenfail_services.store.clock import LeaseClock, length_ms, now_ms
from eigenfail_services.store.engine import Database
from eigenfail_services.store.schema import analyses, campaigns, jobs

# A lease that is yet to begin is of another clock: of before the machine was started anew.
_BEGUN_MS = jobs.c.lease_until_ms - jobs.c.lease_ms
LEASE_OVER = (jobs.c.lease_until_ms <= LeaseClock()) | (LeaseClock() < _BEGUN_MS)


def lease_columns(lease_s: float) -> dict[str, Any]:
    """Return the columns of a lease that begins now."""
    length = length_ms(lease_s)
    return {"lease_until_ms": LeaseClock() + length, "lease_ms": length}


def holds_token(job: Job) -> sa.ColumnElement[bool]:
    """Return the condition that a job still has the token of this claim."""
    return (jobs.c.id == job.id) & (jobs.c.token == job.token)


def fence(connection: sa.Connection, claim: Job | None) -> None:
    """Refuse to go on unless a claim is still held; None needs no claim.

    The subject must be locked before. The job stays the holder's until the transaction ends.

    Raises:
        ClaimLost: the job was claimed by another service since, or is no longer there.
    """
    if claim is None:
        return
    # No other process claims it or takes it away meanwhile; its lease may be renewed.
    theirs = (
        sa.select(jobs.c.id).where(holds_token(claim)).with_for_update(read=True, key_share=True)
    )
    if connection.execute(theirs).first() is None:
        raise ClaimLost(
            f"The {claim.kind} {claim.subject} belongs to another process: the lease ran out, or "
            "it was paused, resumed or ended meanwhile.",
            "No action is needed: nothing was written, and the process that has claimed it goes "
            "on.",
        )


MAX_ATTEMPTS = 5
"""Claims of one job in a row without progress, before the job becomes a dead letter."""

DEAD_LETTER_REASON = (
    f"The process that worked on it was lost {MAX_ATTEMPTS} times in a row without progress. "
    "The service's log says why; launch it again after fixing the cause."
)

SUBJECTS: Mapping[JobKind, sa.Table] = {JobKind.CAMPAIGN: campaigns, JobKind.ANALYSIS: analyses}

NOT_DEAD = jobs.c.buried_because.is_(None)
# Asked all the time, so made once: building a statement costs more than running it.
_WAITING = (
    sa.select(sa.func.count())
    .select_from(jobs)
    .where(jobs.c.kind == sa.bindparam("wanted"), NOT_DEAD, LEASE_OVER)
)
_LEASED = sa.select(jobs.c.owner, jobs.c.token).where(
    jobs.c.token.is_not(None), NOT_DEAD, sa.not_(LEASE_OVER)
)

OnDead = Callable[[sa.Connection, int, str], object]


def enqueue(connection: sa.Connection, kind: JobKind, subject: int) -> None:
    """Add a job at the end of the queue; a leftover job of the subject is withdrawn."""
    withdraw(connection, kind, subject)
    connection.execute(
        sa.insert(jobs).values(
            kind=kind,
            subject=subject,
            queued_ms=now_ms(),
            lease_until_ms=0,
            lease_ms=0,
            attempts=0,
            progress=0,
        )
    )


def withdraw(connection: sa.Connection, kind: JobKind, subject: int) -> None:
    """Remove the job of a subject from the queue, even if it is claimed."""
    connection.execute(sa.delete(jobs).where(jobs.c.kind == kind, jobs.c.subject == subject))


class JobQueue:
    """Claims, leases and dead letters.

    Attempts count the claims since the work last made progress: a campaign whose results are stored
    never becomes a dead letter, however often its supervisor is lost.

    Args:
        database: the database with the queue.
        on_dead: for each kind of job, a function that makes its subject fail, given the subject's
            id and the reason.
    """

    def __init__(self, database: Database, on_dead: Mapping[JobKind, OnDead]) -> None:
        self._database = database
        self._on_dead = on_dead

    def claim(self, owner: str, lease_s: float, kind: JobKind | None = None) -> Job | None:
        """Lease the next free job (of a kind) to the owner, and return it.

        The oldest job is next, and each campaign counts as older by its priority's head start. A
        job that was claimed too often becomes a dead letter instead, and its subject fails.
        """
        while (job := self._take(owner, lease_s, kind)) and job.attempts > MAX_ATTEMPTS:
            self._dead_letter(job)
        return job

    def _take(self, owner: str, lease_s: float, kind: JobKind | None) -> Job | None:
        first = (
            sa.select(jobs.c.id)
            .where(_is_free(kind))
            .order_by(_queue_place(), jobs.c.id)
            .limit(1)
            .with_for_update(skip_locked=True)
        )
        progress = _count_finished()
        statement = (
            sa.update(jobs)
            .where(jobs.c.id == first.scalar_subquery())
            .values(
                owner=owner,
                token=uuid4().hex,
                **lease_columns(lease_s),
                attempts=sa.case((progress > jobs.c.progress, 1), else_=jobs.c.attempts + 1),
                progress=progress,
            )
            .returning(jobs.c.id, jobs.c.kind, jobs.c.subject, jobs.c.token, jobs.c.attempts)
        )
        with self._database.writing() as connection:
            found = connection.execute(statement).one_or_none()
        return None if found is None else Job(found.id, JobKind(found.kind), *found[2:])

    def _dead_letter(self, job: Job) -> None:
        table = SUBJECTS[job.kind]
        # Everybody locks the subject first and its job second.
        lock = (
            sa.select(table.c.id).where(table.c.id == job.subject).with_for_update(key_share=True)
        )
        dead_letter = (
            sa.update(jobs)
            .where(holds_token(job))
            .values(token=None, buried_because=DEAD_LETTER_REASON)
        )
        with self._database.writing() as connection:
            connection.execute(lock)
            if connection.execute(dead_letter).rowcount:
                self._on_dead[job.kind](connection, job.subject, DEAD_LETTER_REASON)

    def renew(self, job: Job, lease_s: float) -> bool:
        """Extend the lease of a job, or, with 0, give it back; return False if it was lost."""
        statement = sa.update(jobs).where(holds_token(job)).values(**lease_columns(lease_s))
        with self._database.writing() as connection:
            return connection.execute(statement).rowcount == 1

    def let_go(self, is_lost: Callable[[str], bool]) -> int:
        """Free the jobs that are leased to lost owners; return their number."""
        with self._database.reading() as connection:
            found = connection.execute(_LEASED).all()
        lost = [row.token for row in found if is_lost(row.owner)]
        if not lost:
            return 0
        free_now = sa.update(jobs).where(jobs.c.token.in_(lost)).values(**lease_columns(0.0))
        with self._database.writing() as connection:
            return connection.execute(free_now).rowcount

    def finish(self, job: Job) -> bool:
        """Remove a job that is done; return False if its lease was lost."""
        with self._database.writing() as connection:
            return connection.execute(sa.delete(jobs).where(holds_token(job))).rowcount == 1

    def waiting(self, kind: JobKind) -> int:
        """Count the jobs of a kind that wait to be claimed."""
        with self._database.reading() as connection:
            return connection.execute(_WAITING, {"wanted": kind}).scalar_one()


def _is_free(kind: JobKind | None) -> sa.ColumnElement[bool]:
    wanted = sa.true() if kind is None else jobs.c.kind == kind
    return wanted & NOT_DEAD & LEASE_OVER


def _queue_place() -> sa.ColumnElement[int]:
    """Return a job's place in the queue: when it was queued, less its priority's head start."""
    starts = {priority.value: priority.head_start_ms for priority in Priority}
    head_start = (
        sa.select(sa.case(starts, value=campaigns.c.priority))
        .where(campaigns.c.id == jobs.c.subject, jobs.c.kind == JobKind.CAMPAIGN)
        .scalar_subquery()
    )
    return jobs.c.queued_ms - sa.func.coalesce(head_start, Priority.NORMAL.head_start_ms)


def _count_finished() -> sa.ColumnElement[int]:
    count = (
        sa.select(campaigns.c.completed + campaigns.c.failed)
        .where(campaigns.c.id == jobs.c.subject, jobs.c.kind == JobKind.CAMPAIGN)
        .scalar_subquery()
    )
    return sa.func.coalesce(count, 0)
