"""The learner's last states of each campaign, in SQL."""

from hashlib import sha256
from typing import NamedTuple

import structlog
from sqlalchemy import Connection, delete, func, insert, select

from eigenfail.values import Estimate
from eigenfail.values.records import Job
from eigenfail_services.store import sentences
from eigenfail_services.store.campaign_rows import locked, write_told
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.engine import Database
from eigenfail_services.store.events import append
from eigenfail_services.store.leases import fence
from eigenfail_services.store.limits import KEPT_CHECKPOINTS
from eigenfail_services.store.refusals import damaged_checkpoint
from eigenfail_services.store.schema import checkpoints

log = structlog.get_logger()


class Found(NamedTuple):
    """The newest checkpoint that is whole, and the numbers of those after it, which are not."""

    state: bytes | None
    damaged: tuple[int, ...]


class SqlCheckpoints:
    """The last two checkpoints of each campaign, each with the hash of all of it."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def save(
        self,
        campaign: int,
        checkpoint: bytes,
        estimate: Estimate | None = None,
        trained_episodes: int | None = None,
        claim: Job | None = None,
    ) -> None:
        """A new checkpoint, and what the campaign's learner told, all or nothing.

        Raises:
            NotFound: no such campaign.
            ClaimLost: the claim is no longer the campaign's.
        """
        values = {"state": checkpoint, "sha256": digest(checkpoint), "saved_ms": now_ms()}
        ours = checkpoints.c.campaign == campaign
        last = select(func.coalesce(func.max(checkpoints.c.number), 0)).where(ours)
        with self._database.writing() as connection:
            locked(connection, campaign)
            fence(connection, claim)
            write_told(connection, campaign, estimate, trained_episodes)
            number = connection.execute(last).scalar_one() + 1
            connection.execute(
                insert(checkpoints).values(campaign=campaign, number=number, **values)
            )
            oldest = checkpoints.c.number <= number - KEPT_CHECKPOINTS
            connection.execute(delete(checkpoints).where(ours, oldest))

    def load(self, campaign: int) -> bytes | None:
        """The newest checkpoint that is whole, if there is one.

        Raises:
            ProtocolError: there are checkpoints, and none is whole.
        """
        with self._database.reading() as connection:
            return newest_whole(connection, campaign).state

    def recover(self, campaign: int, claim: Job | None = None) -> bytes | None:
        """The same, to go on from: newer ones that are damaged are dropped, with an event.

        Raises:
            NotFound: no such campaign.
            ClaimLost: the claim is no longer the campaign's.
            ProtocolError: there are checkpoints, and none is whole.
        """
        with self._database.writing() as connection:
            locked(connection, campaign)
            fence(connection, claim)
            state, damaged = newest_whole(connection, campaign)
            if damaged:
                drop(connection, campaign, damaged)
        return state


def newest_whole(connection: Connection, campaign: int) -> Found:
    """What to go on from; read one after the other, as they may be large.

    Raises:
        ProtocolError: there are checkpoints, and none is whole.
    """
    mine = checkpoints.c.campaign == campaign
    numbers = select(checkpoints.c.number).where(mine).order_by(checkpoints.c.number.desc())
    damaged: list[int] = []
    for number in connection.execute(numbers).scalars().all():
        columns = select(checkpoints.c.state, checkpoints.c.sha256)
        kept = connection.execute(columns.where(mine, checkpoints.c.number == number)).one()
        if is_whole(*kept):
            return Found(kept.state, tuple(damaged))
        damaged.append(number)
    if damaged:
        raise damaged_checkpoint(campaign)
    return Found(None, ())


def drop(connection: Connection, campaign: int, damaged: tuple[int, ...]) -> None:
    """Forget checkpoints that are not what was saved, and say so."""
    mine = (checkpoints.c.campaign == campaign) & checkpoints.c.number.in_(damaged)
    connection.execute(delete(checkpoints).where(mine))
    tell_damaged(campaign)
    append(connection, "checkpoint.damaged", sentences.checkpoint_damaged(campaign), campaign)


def tell_damaged(campaign: int) -> None:
    """A line in the log."""
    log.warning("checkpoint damaged, the one before it is used", campaign=campaign)


def digest(state: bytes) -> str:
    """SHA-256 of a checkpoint: of the learner's state and of the open rounds beside it."""
    return sha256(state).hexdigest()


def is_whole(state: bytes, kept: str | None) -> bool:
    """Whether a state is the one that was saved; where an older release kept no hash, it is."""
    return kept is None or digest(state) == kept
