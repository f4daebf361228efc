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
from eigenfail_services.store.refusals import key_used
from eigenfail_services.store.schema import idempotency_keys


def create(connection: Connection, spec: CampaignSpec, key: str | None) -> Campaign:
    """A new campaign, or the one that the key has made."""
    if key is None:
        return queued(connection, spec)
    if earlier := made_with(connection, [key], spec_hash(spec)):
        return earlier[0]
    campaign = queued(connection, spec)
    remember(connection, [key], spec_hash(spec), [campaign])
    return campaign


def create_many(
    connection: Connection, specs: Sequence[CampaignSpec], key: str | None
) -> tuple[Campaign, ...]:
    """New campaigns in their order, or those that the key has made."""
    if key is None:
        return tuple(queued(connection, spec) for spec in specs)
    keys, asked = [key_of(key, place) for place in range(len(specs))], hash_of(specs)
    if earlier := made_with(connection, keys, asked):
        return earlier
    made = tuple(queued(connection, spec) for spec in specs)
    remember(connection, keys, asked, made)
    return made


def queued(connection: Connection, spec: CampaignSpec) -> Campaign:
    """A new campaign with its job and its event."""
    campaign = add(connection, spec)
    enqueue(connection, JobKind.CAMPAIGN, campaign.id)
    append(connection, "campaign.created", sentences.campaign_created(campaign), campaign.id)
    return campaign


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
