"""New campaigns in SQL: one or many, once for each key."""

from collections.abc import Sequence
from hashlib import sha256

from sqlalchemy import Connection, insert, select

from eigenfail.values import Campaign, CampaignSpec
from eigenfail.values.records import JobKind
from eigenfail_services.store import sentences
from eigenfail_services.store.campaign_rows import add, one
from eigenfail_services.store.codec import spec_hash
from eigenfail_services.store.events import append
from eigenfail_services.store.jobs import enqueue
from eigenfail_services.store.naming import hold
from eigenfail_services.store.quotas import admit
from eigenfail_services.store.refusals import key_used
from eigenfail_services.store.retention import refuse_gone
from eigenfail_services.store.schema import idempotency_keys


def create(
    connection: Connection, spec: CampaignSpec, key: str | None, made_by: int | None
) -> Campaign:
    """A new campaign, or the one that the key has made."""
    if key is None:
        return queued(connection, [spec], made_by)[0]
    if earlier := made_with(connection, [key], spec_hash(spec)):
        return earlier[0]
    made = queued(connection, [spec], made_by)
    remember(connection, [key], spec_hash(spec), made)
    return made[0]


def create_many(
    connection: Connection, specs: Sequence[CampaignSpec], key: str | None, made_by: int | None
) -> tuple[Campaign, ...]:
    """New campaigns in their order, or those that the key has made."""
    if key is None:
        return queued(connection, specs, made_by)
    keys, asked = [key_of(key, place) for place in range(len(specs))], hash_of(specs)
    if earlier := made_with(connection, keys, asked):
        return earlier
    made = queued(connection, specs, made_by)
    remember(connection, keys, asked, made)
    return made


def queued(
    connection: Connection, specs: Sequence[CampaignSpec], made_by: int | None
) -> tuple[Campaign, ...]:
    """New campaigns with their jobs and their events.

    Raises:
        QuotaExceeded: whoever makes them may not have so many, or so much in them.
        NoisePruned: one names an episode that has lost its noise.
    """
    hold(connection, specs)
    refuse_gone(connection, specs)
    admit(connection, made_by, specs)
    made = tuple(add(connection, spec, made_by) for spec in specs)
    for campaign in made:
        enqueue(connection, JobKind.CAMPAIGN, campaign.id)
        append(connection, "campaign.created", sentences.campaign_created(campaign), campaign.id)
    return made


def made_with(connection: Connection, keys: Sequence[str], asked: str) -> tuple[Campaign, ...]:
    """The campaigns that these keys have made, in the order of the keys; none if none has.

    Raises:
        IdempotencyMismatch: they were made by a request for something else.
    """
    query = select(idempotency_keys).where(idempotency_keys.c.key.in_(keys))
    known = {row.key: row for row in connection.execute(query)}
    for row in known.values():
        if row.spec_hash != asked:
            raise key_used(row.campaign)
    return tuple(one(connection, known[key].campaign) for key in keys if key in known)


def remember(
    connection: Connection, keys: Sequence[str], asked: str, made: Sequence[Campaign]
) -> None:
    """Which campaign each key has made, and of what was asked for."""
    rows = [
        {"key": key, "spec_hash": asked, "campaign": campaign.id}
        for key, campaign in zip(keys, made, strict=True)
    ]
    if rows:
        connection.execute(insert(idempotency_keys), rows)


def key_of(key: str, place: int) -> str:
    """The key of one campaign of a request for many; no single campaign's key is like it."""
    return f"bulk-{sha256(f'{place} {key}'.encode()).hexdigest()}"


def hash_of(specs: Sequence[CampaignSpec]) -> str:
    """SHA-256 of all specs of a request, to recognise it by."""
    return sha256("\n".join(map(spec_hash, specs)).encode()).hexdigest()
