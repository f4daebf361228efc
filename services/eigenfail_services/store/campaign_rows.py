"""The rows of campaigns: read, locked, written."""

from typing import Any

from sqlalchemy import Connection, Select, bindparam, insert, select, update

from eigenfail.values import Campaign, CampaignSpec, CampaignState, Counts, Estimate
from eigenfail.values.suite import suite_of
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.codec import COUNTS, OVERHEAD, spec_text, to_campaign, to_json
from eigenfail_services.store.refusals import no_campaign
from eigenfail_services.store.schema import campaigns

# Made once: they are asked for with every group of results.
ONE = select(campaigns).where(campaigns.c.id == bindparam("campaign"))
LOCKED = ONE.with_for_update(key_share=True)
COUNTED = update(campaigns).where(campaigns.c.id == bindparam("campaign"))


def one(connection: Connection, campaign: int, row: Select[*tuple[Any, ...]] = ONE) -> Campaign:
    """The campaign of an id.

    Raises:
        NotFound: no such campaign.
    """
    found = connection.execute(row, {"campaign": campaign}).mappings().one_or_none()
    if found is None:
        raise no_campaign(campaign)
    return to_campaign(found)


def locked(connection: Connection, campaign: int) -> Campaign:
    """The campaign as it stands, and as it will stand until this transaction changes it.

    Raises:
        NotFound: no such campaign.
    """
    return one(connection, campaign, LOCKED)


def add(connection: Connection, spec: CampaignSpec, made_by: int | None = None) -> Campaign:
    """A new campaign, queued, made by the holder of a key."""
    statement = (
        insert(campaigns)
        .values(
            state=CampaignState.QUEUED,
            spec=spec_text(spec),
            priority=spec.priority,
            made_by=made_by,
            created_ms=now_ms(),
            active_s=0.0,
            stopped_because="",
            suite=suite_of(spec.name),
            **dict.fromkeys(OVERHEAD, 0.0),
            **counted(Counts(spec.episodes)),
        )
        .returning(campaigns)
    )
    return to_campaign(connection.execute(statement).mappings().one())


def write(connection: Connection, campaign: Campaign) -> None:
    """Bring a locked campaign's row up to date."""
    connection.execute(
        update(campaigns)
        .where(campaigns.c.id == campaign.id)
        .values(
            state=campaign.state,
            started_ms=campaign.started_ms,
            ended_ms=campaign.ended_ms,
            stopped_because=campaign.stopped_because,
            digest=campaign.digest,
            **counted(campaign.counts),
        )
    )


def write_counts(connection: Connection, campaign: int, counts: Counts) -> None:
    """The new counts of a locked campaign."""
    connection.execute(COUNTED, {"campaign": campaign} | counted(counts))


def write_told(
    connection: Connection, campaign: int, estimate: Estimate | None, trained_episodes: int | None
) -> None:
    """What a locked campaign's learner knows now of the failure probability and of itself."""
    text = None if estimate is None else to_json(estimate)
    connection.execute(
        update(campaigns)
        .where(campaigns.c.id == campaign)
        .values(estimate=text, trained_episodes=trained_episodes)
    )


def counted(counts: Counts) -> dict[str, int]:
    """Counts as columns."""
    return {name: getattr(counts, name) for name in COUNTS}
