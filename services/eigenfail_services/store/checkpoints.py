"""The learner's last state of each campaign, in SQL."""

from sqlalchemy import insert, select, update

from eigenfail.values import Estimate
from eigenfail_services.store.campaign_rows import locked, write_told
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.engine import Database
from eigenfail_services.store.schema import checkpoints


class SqlCheckpoints:
    """One checkpoint for each campaign."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def save(
        self,
        campaign: int,
        checkpoint: bytes,
        estimate: Estimate | None = None,
        trained_episodes: int | None = None,
    ) -> None:
        """Replace the checkpoint and what the campaign's learner told, all or nothing.

        Raises:
            NotFound: no such campaign.
        """
        values = {"state": checkpoint, "saved_ms": now_ms()}
        replace = update(checkpoints).where(checkpoints.c.campaign == campaign).values(**values)
        with self._database.writing() as connection:
            locked(connection, campaign)
            write_told(connection, campaign, estimate, trained_episodes)
            if not connection.execute(replace).rowcount:
                connection.execute(insert(checkpoints).values(campaign=campaign, **values))

    def load(self, campaign: int) -> bytes | None:
        """The checkpoint, if there is one."""
        query = select(checkpoints.c.state).where(checkpoints.c.campaign == campaign)
        with self._database.reading() as connection:
            return connection.execute(query).scalar_one_or_none()
