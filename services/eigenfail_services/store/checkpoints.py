"""The last two learner states of each campaign."""

from hashlib import sha256

import structlog
from sqlalchemy import Connection, delete, func, insert, select

from eigenfail.errors import ProtocolError
from eigenfail.values.estimates import Estimate
from eigenfail.values.records import Job
from eigenfail_services.store.campaign_rows import lock_campaign, update_learner
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.engine import StorePart
from eigenfail_services.store.events import append_event
from eigenfail_services.store.jobs import fence
from eigenfail_services.store.schema import checkpoints

log = structlog.get_logger()

KEPT_CHECKPOINTS = 2
"""Checkpoints that are kept of each campaign: the last one, and the one to fall back to."""


class CheckpointStore(StorePart):
    """The last two checkpoints of each campaign, with a hash each, and the learner's estimate.

    The older checkpoint is the fallback if the last one is damaged.
    """

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
            ProtocolError: checkpoints exist, but every one is damaged.
        """
        with self._database.reading() as connection:
            state, _damaged = _find_newest(connection, campaign)
        return state

    def recover(self, campaign: int, claim: Job | None = None) -> bytes | None:
        """Return the newest undamaged checkpoint, and delete newer, damaged ones with an event.

        Raises:
            NotFound: no such campaign.
            ClaimLost: the claim is no longer the campaign's.
            ProtocolError: checkpoints exist, but every one is damaged.
        """
        with self._database.writing() as connection:
            lock_campaign(connection, campaign)
            fence(connection, claim)
            # The fence above comes first: a process that has lost the campaign must not delete
            # checkpoints of its successor.
            state, damaged = _find_newest(connection, campaign)
            if damaged:
                ours = (checkpoints.c.campaign == campaign) & checkpoints.c.number.in_(damaged)
                connection.execute(delete(checkpoints).where(ours))
                log.warning("checkpoint damaged, the one before it is used", campaign=campaign)
                append_event(
                    connection,
                    "checkpoint.damaged",
                    f"The last checkpoint of campaign {campaign} is damaged: its SHA-256 does not "
                    "match. The campaign goes on from the one before it, with the same episodes. "
                    "Check the disk.",
                    campaign,
                )
        return state


def _find_newest(connection: Connection, campaign: int) -> tuple[bytes | None, list[int]]:
    """Return the newest undamaged checkpoint, and the numbers of damaged ones after it.

    Raises:
        ProtocolError: checkpoints exist, but every one is damaged.
    """
    mine = checkpoints.c.campaign == campaign
    numbers = select(checkpoints.c.number).where(mine).order_by(checkpoints.c.number.desc())
    damaged: list[int] = []
    # One by one, as a state may have many megabytes.
    for number in connection.execute(numbers).scalars().all():
        columns = select(checkpoints.c.state, checkpoints.c.sha256)
        kept = connection.execute(columns.where(mine, checkpoints.c.number == number)).one()
        if hash_state(kept.state) == kept.sha256:
            return kept.state, damaged
        damaged.append(number)
    if damaged:
        raise ProtocolError(
            f"The checkpoint of campaign {campaign} cannot be read: its SHA-256 does not match, "
            "and there is no older one that is whole.",
            "Launch the campaign again.",
        )
    return None, []


def hash_state(state: bytes) -> str:
    """Return the SHA-256 of a checkpoint: the learner's state and the open rounds."""
    return sha256(state).hexdigest()
