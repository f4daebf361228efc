"""Rows of campaigns: how they are read, locked and written."""

from hashlib import sha256
from typing import Any

from msgspec import UNSET
from sqlalchemy import Connection, Select, bindparam, insert, select, update

from eigenfail.errors import NotFound
from eigenfail.values.campaign import Campaign, CampaignState, Counts
from eigenfail.values.estimates import Estimate
from eigenfail.values.suite import suite_of
from eigenfail_services.resolution import CheckedCampaign
from eigenfail_services.store import codec
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.engine import CHUNK
from eigenfail_services.store.schema import campaigns, episode_index, episodes

# Built once: they are executed with every group of results.
_BY_ID = select(campaigns).where(campaigns.c.id == bindparam("campaign"))
# In PostgreSQL this lock (FOR NO KEY UPDATE) lets other transactions insert rows that refer to the
# campaign. SQLite has one writer at a time anyway.
_BY_ID_LOCKED = _BY_ID.with_for_update(key_share=True)
_SET_COUNTS = update(campaigns).where(campaigns.c.id == bindparam("campaign"))


def read_campaign(
    connection: Connection, campaign: int, row: Select[*tuple[Any, ...]] = _BY_ID
) -> Campaign:
    """Return the campaign with an id.

    Raises:
        NotFound: no such campaign.
    """
    found = connection.execute(row, {"campaign": campaign}).mappings().one_or_none()
    if found is None:
        problem = f"Campaign {campaign} does not exist."
        raise NotFound(problem, "`eigenfail campaign list` lists them.")
    return codec.to_campaign(found)


def lock_campaign(connection: Connection, campaign: int) -> Campaign:
    """Return a campaign and lock its row until the transaction ends.

    Raises:
        NotFound: no such campaign.
    """
    return read_campaign(connection, campaign, _BY_ID_LOCKED)


def name_campaign(campaign: Campaign) -> str:
    """Return a campaign by id and name, for messages."""
    return f"Campaign {campaign.id} '{campaign.spec.name}'"


def insert_campaign(
    connection: Connection, wanted: CheckedCampaign, made_by: int | None
) -> Campaign:
    """Insert the row of a queued campaign with no results, and return the campaign."""
    spec = wanted.spec
    statement = (
        insert(campaigns)
        .values(
            state=CampaignState.QUEUED,
            spec=codec.spec_text(spec),
            priority=spec.priority,
            planner_version=spec.version or None,
            project=None if spec.project is UNSET else spec.project,
            tags=codec.to_tags_text(spec.all_tags),
            made_by=made_by,
            created_ms=now_ms(),
            active_s=0.0,
            stopped_because="",
            suite=suite_of(spec.name),
            # Stored, so that later campaigns, analyses and the claim read rows: a plug-in may be
            # another one by then, or gone.
            form=codec.to_json(wanted.form),
            references=codec.to_json(wanted.references),
            **dict.fromkeys(codec.OVERHEAD, 0.0),
            **count_columns(Counts(spec.episodes)),
        )
        .returning(campaigns)
    )
    return codec.to_campaign(connection.execute(statement).mappings().one())


def update_campaign(connection: Connection, campaign: Campaign) -> None:
    """Write the state, the times, the counts and the digest of a locked campaign."""
    connection.execute(
        update(campaigns)
        .where(campaigns.c.id == campaign.id)
        .values(
            state=campaign.state,
            started_ms=campaign.started_ms,
            ended_ms=campaign.ended_ms,
            stopped_because=campaign.stopped_because,
            digest=campaign.digest,
            **count_columns(campaign.counts),
        )
    )


def update_counts(connection: Connection, campaign: int, counts: Counts) -> None:
    """Write the counts of a locked campaign."""
    connection.execute(_SET_COUNTS, {"campaign": campaign} | count_columns(counts))


def update_learner(
    connection: Connection, campaign: int, estimate: Estimate | None, trained_episodes: int | None
) -> None:
    """Write the estimate of a locked campaign's learner, and its number of trained episodes."""
    text = None if estimate is None else codec.to_json(estimate)
    connection.execute(
        update(campaigns)
        .where(campaigns.c.id == campaign)
        .values(estimate=text, trained_episodes=trained_episodes)
    )


def count_columns(counts: Counts) -> dict[str, int]:
    """Return counts as columns of a campaign's row."""
    return {column: getattr(counts, name) for column, name in codec.COUNTS.items()}


def hash_results(connection: Connection, campaign: int) -> str:
    """Return the SHA-256 over one line "index digest" for each result, in index order."""
    # The order of the index makes equal campaigns have equal digests, in whatever order results
    # arrived. A campaign may have ten million results, so they are read in portions.
    query = (
        select(episode_index, episodes.c.digest)
        .where(episodes.c.campaign == campaign)
        .order_by(episode_index)
        .execution_options(yield_per=CHUNK)
    )
    lines = sha256()
    for index, known in connection.execute(query):
        lines.update(f"{index} {known}\n".encode())
    return lines.hexdigest()
