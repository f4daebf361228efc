"""What is safe to mend: counts, which the rows tell; jobs that nobody needs any more."""

from collections.abc import Iterator

from sqlalchemy import Connection, delete, func, select, update

from eigenfail.values import FINAL_STATES, Campaign, Counts, Outcome
from eigenfail_services.store.campaign_rows import counted, locked
from eigenfail_services.store.engine import Database
from eigenfail_services.store.events import append
from eigenfail_services.store.schema import campaigns, episodes, jobs
from eigenfail_services.upkeep.checks import ENDED, left_over, miscounted, unaccounted

EVENT = "database.mended"


def mend(database: Database) -> tuple[str, ...]:
    """Put right what can be, all or nothing, and log an event; one sentence for each thing.

    Safe beside a service: a campaign is locked while it is counted.
    """
    with database.writing() as connection:
        done = (*recounted(connection), *withdrawn(connection))
        if done:
            append(connection, EVENT, f"The database was mended. {' '.join(done)}")
    return done


def recounted(connection: Connection) -> Iterator[str]:
    """Count the rows of every campaign whose counts are wrong."""
    suspects = {
        found.id for query in (miscounted(), unaccounted()) for found in connection.execute(query)
    }
    for suspect in sorted(suspects):
        # What was found before the lock may have changed: it is counted under it.
        campaign = locked(connection, suspect)
        counts = counts_of(connection, campaign)
        if counts.completed + counts.failed > counts.planned or counts == campaign.counts:
            continue
        change = update(campaigns).where(campaigns.c.id == suspect)
        connection.execute(change.values(**counted(counts)))
        yield (
            f"Campaign {suspect} was counted anew: {counts.completed} completed, "
            f"{counts.failed} failed, {counts.failures} failures, {counts.cancelled} cancelled."
        )


def counts_of(connection: Connection, campaign: Campaign) -> Counts:
    """What a campaign's rows amount to; what has ended has nothing open."""
    of_outcome = episodes.c.outcome
    ended, failed, failures = connection.execute(
        select(
            func.count(),
            func.count().filter(of_outcome == Outcome.FAILED),
            func.count().filter(of_outcome == Outcome.COLLISION),
        ).where(episodes.c.campaign == campaign.id)
    ).one()
    planned = campaign.counts.planned
    return Counts(
        planned=planned,
        completed=ended - failed,
        failures=failures,
        failed=failed,
        cancelled=planned - ended if campaign.state in FINAL_STATES else 0,
        duplicates=campaign.counts.duplicates,
    )


def withdrawn(connection: Connection) -> Iterator[str]:
    """Take away the jobs that are left over."""
    for kind in ENDED:
        removal = delete(jobs).where(left_over(kind)).returning(jobs.c.id, jobs.c.subject)
        for job, subject in connection.execute(removal):
            yield f"Job {job} for {kind} {subject} was taken away."
