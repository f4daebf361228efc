"""Whose a job is, and for how long, in SQL."""

from typing import Any

from sqlalchemy import ColumnElement, Connection, select

from eigenfail.values.records import Job
from eigenfail_services.store.clock import LeaseClock, length_ms
from eigenfail_services.store.refusals import claim_lost
from eigenfail_services.store.schema import jobs

# A lease that is yet to begin is of another clock: of before the machine was started anew.
BEGUN_MS = jobs.c.lease_until_ms - jobs.c.lease_ms
LEASE_OVER = (jobs.c.lease_until_ms <= LeaseClock()) | (LeaseClock() < BEGUN_MS)


def leased(lease_s: float) -> dict[str, Any]:
    """A lease that begins now, as columns."""
    length = length_ms(lease_s)
    return {"lease_until_ms": LeaseClock() + length, "lease_ms": length}


def held(job: Job) -> ColumnElement[bool]:
    """The job as long as the token is its own."""
    return (jobs.c.id == job.id) & (jobs.c.token == job.token)


def fence(connection: Connection, claim: Job | None) -> None:
    """Let only the holder of a claim go on; None is whoever needs no claim.

    The subject must be locked before. The job stays the holder's until the transaction ends.

    Raises:
        ClaimLost: somebody else has claimed the job since, or it is no more.
    """
    if claim is None:
        return
    # Nobody claims it or takes it away meanwhile; its lease may be renewed.
    theirs = select(jobs.c.id).where(held(claim)).with_for_update(read=True, key_share=True)
    if connection.execute(theirs).first() is None:
        raise claim_lost(claim)
