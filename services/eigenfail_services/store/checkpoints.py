"""The last two learner states of each campaign."""

from hashlib import sha256
from typing import NamedTuple

import structlog
from sqlalchemy import Connection, delete, func, insert, select

from eigenfail.values.estimates import Estimate
from eigenfail.values.records import Job
from eigenfail_services.store.campaign_rows import lock_campaign, update_learner
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.engine import Database
from eigenfail_services.store.errors import make_checkpoint_error
from eigenfail_services.store.events import append_event, describe_damage
from eigenfail_services.store.jobs import fence
from eigenfail_services.store.schema import checkpoints

log = structlog.get_logger()

KEPT_CHECKPOINTS = 2
"""Checkpoints that are kept of each campaign: the last one, and the one to fall back to."""


class NewestCheckpoint(NamedTuple):
    """The newest checkpoint that is whole, and the numbers of those after it, which are not."""

    state: bytes | None
    damaged: tuple[int, ...]


class CheckpointStore:
    """The last two checkpoints of each campaign, with a hash each, and the learner's estimate.

    The one before the last is there to fall back to if the last one is damaged.
    """

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
        """Save a checkpoint, and the estimate of the campaign's learner, all or nothing.

        Args:
            campaign: id of the campaign.
            checkpoint: the learner's state and the open rounds; its SHA-256 is stored with it.
            estimate: estimate of the failure probability.
            trained_episodes: number of episodes that the learner was trained with.
            claim: claim of the service that runs the campaign.

        Raises:
            NotFound: no such campaign.
            ClaimLost: the claim is no longer the campaign's; nothing is saved.
        """
        values = {"state": checkpoint, "sha256": hash_state(checkpoint), "saved_ms": now_ms()}
        ours = checkpoints.c.campaign == campaign
        last = select(func.coalesce(func.max(checkpoints.c.number), 0)).where(ours)
        with self._database.writing() as connection:
            lock_campaign(connection, campaign)
            fence(connection, claim)
            update_learner(connection, campaign, estimate, trained_episodes)
            # The lock on the campaign keeps another process from taking the same number.
            number = connection.execute(last).scalar_one() + 1
            connection.execute(
                insert(checkpoints).values(campaign=campaign, number=number, **values)
            )
            # The new checkpoint and the deletion are one transaction: a crash leaves a checkpoint
            # to start from.
            oldest = checkpoints.c.number <= number - KEPT_CHECKPOINTS
            connection.execute(delete(checkpoints).where(ours, oldest))

    def load(self, campaign: int) -> bytes | None:
        """Return the newest undamaged checkpoint, or None.

        Raises:
            ProtocolError: there are checkpoints, and all are damaged.
        """
        with self._database.reading() as connection:
            return _find_newest(connection, campaign).state

    def recover(self, campaign: int, claim: Job | None = None) -> bytes | None:
        """Return the newest undamaged checkpoint, and delete newer, damaged ones with an event.

        Raises:
            NotFound: no such campaign.
            ClaimLost: the claim is no longer the campaign's.
            ProtocolError: there are checkpoints, and all are damaged.
        """
        with self._database.writing() as connection:
            lock_campaign(connection, campaign)
            fence(connection, claim)
            # The fence above comes first: a process that has lost the campaign must not delete
            # checkpoints of its successor.
            state, damaged = _find_newest(connection, campaign)
            if damaged:
                _drop_damaged(connection, campaign, damaged)
        return state


def _find_newest(connection: Connection, campaign: int) -> NewestCheckpoint:
    """Return the newest undamaged checkpoint; they are read one by one, as they may be large.

    Raises:
        ProtocolError: there are checkpoints, and all are damaged.
    """
    mine = checkpoints.c.campaign == campaign
    numbers = select(checkpoints.c.number).where(mine).order_by(checkpoints.c.number.desc())
    damaged: list[int] = []
    for number in connection.execute(numbers).scalars().all():
        columns = select(checkpoints.c.state, checkpoints.c.sha256)
        kept = connection.execute(columns.where(mine, checkpoints.c.number == number)).one()
        if is_whole(*kept):
            return NewestCheckpoint(kept.state, tuple(damaged))
        damaged.append(number)
    if damaged:
        raise make_checkpoint_error(campaign)
    return NewestCheckpoint(None, ())


def _drop_damaged(connection: Connection, campaign: int, damaged: tuple[int, ...]) -> None:
    mine = (checkpoints.c.campaign == campaign) & checkpoints.c.number.in_(damaged)
    connection.execute(delete(checkpoints).where(mine))
    tell_damaged(campaign)
    append_event(connection, "checkpoint.damaged", describe_damage(campaign), campaign)


def tell_damaged(campaign: int) -> None:
    """Log that a checkpoint is damaged and that the one before it is used."""
    log.warning("checkpoint damaged, the one before it is used", campaign=campaign)


def hash_state(state: bytes) -> str:
    """Return the SHA-256 of a checkpoint: the learner's state and the open rounds."""
    return sha256(state).hexdigest()


def is_whole(state: bytes, kept: str | None) -> bool:
    """Return whether a state matches its hash; states of older releases have none, and pass."""
    return kept is None or hash_state(state) == kept
