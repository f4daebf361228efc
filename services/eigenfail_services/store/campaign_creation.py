"""Creation of campaigns, which a request that is repeated with its key does not repeat."""

from collections.abc import Mapping, Sequence
from hashlib import sha256

from sqlalchemy import Connection, insert, select

from eigenfail.errors import IdempotencyMismatch
from eigenfail.values.campaign import Campaign
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.records import JobKind
from eigenfail_services.store.access import admit_campaigns
from eigenfail_services.store.campaign_rows import insert_campaign, name_campaign, read_campaign
from eigenfail_services.store.codec import spec_hash
from eigenfail_services.store.events import append_event
from eigenfail_services.store.jobs import enqueue
from eigenfail_services.store.references import hold_named_noise, refuse_pruned
from eigenfail_services.store.schema import idempotency_keys


def create_campaign(
    connection: Connection, spec: CampaignSpec, key: str | None, made_by: int | None
) -> Campaign:
    """Create a campaign, or return the one that the key has created."""
    if key is None:
        return _insert_queued(connection, [spec], made_by)[0]
    if earlier := _find_made_with(connection, [key], spec_hash(spec)):
        return earlier[0]
    made = _insert_queued(connection, [spec], made_by)
    _insert_keys(connection, [key], spec_hash(spec), made)
    return made[0]


def create_campaigns(
    connection: Connection, specs: Sequence[CampaignSpec], key: str | None, made_by: int | None
) -> tuple[Campaign, ...]:
    """Create campaigns in their order, or return those that the key has created."""
    if key is None:
        return _insert_queued(connection, specs, made_by)
    # The hash is of the whole list: a list that only begins alike is another request.
    keys, asked = [derive_key(key, place) for place in range(len(specs))], hash_specs(specs)
    if earlier := _find_made_with(connection, keys, asked):
        return earlier
    made = _insert_queued(connection, specs, made_by)
    _insert_keys(connection, keys, asked, made)
    return made


def create_missing(
    connection: Connection,
    specs: Mapping[str, CampaignSpec],
    made_by: int | None,
) -> tuple[Campaign, ...]:
    """Create the campaigns of the keys that have created none, in their order; return all."""
    found = {
        key: campaign
        for key, spec in specs.items()
        for campaign in _find_made_with(connection, [key], spec_hash(spec))
    }
    missing = [key for key in specs if key not in found]
    if missing:
        made = _insert_queued(connection, [specs[key] for key in missing], made_by)
        for key, campaign in zip(missing, made, strict=True):
            _insert_keys(connection, [key], spec_hash(specs[key]), [campaign])
            found[key] = campaign
    return tuple(found[key] for key in specs)


def _insert_queued(
    connection: Connection, specs: Sequence[CampaignSpec], made_by: int | None
) -> tuple[Campaign, ...]:
    """Create campaigns with their jobs and their events.

    Raises:
        QuotaExceeded: the key's quota of campaigns or episodes would be exceeded.
        NoisePruned: a spec names an episode whose noise was pruned.
    """
    # The noise is held before it is checked: a pruning between the two steps would go unnoticed.
    hold_named_noise(connection, specs)
    refuse_pruned(connection, specs)
    admit_campaigns(connection, made_by, specs)
    made = tuple(insert_campaign(connection, spec, made_by) for spec in specs)
    # All campaigns are inserted before the first event: from an event to the commit, every other
    # writer waits for the counter of events.
    for campaign in made:
        enqueue(connection, JobKind.CAMPAIGN, campaign.id)
        spec = campaign.spec
        message = (
            f"{name_campaign(campaign)} waits in the queue: {spec.episodes} episodes by "
            f"{spec.method}."
        )
        append_event(connection, "campaign.created", message, campaign.id)
    return made


def _find_made_with(
    connection: Connection, keys: Sequence[str], asked: str
) -> tuple[Campaign, ...]:
    """Return the campaigns that these keys have created, in the order of the keys.

    Raises:
        IdempotencyMismatch: they were created by a request for something else.
    """
    query = select(idempotency_keys).where(idempotency_keys.c.key.in_(keys))
    known = {row.key: row for row in connection.execute(query)}
    for row in known.values():
        # Returning the earlier campaign would hide that this request has created nothing.
        if row.spec_hash != asked:
            raise IdempotencyMismatch(
                f"This Idempotency-Key was used for campaign {row.campaign}, which asks for "
                "something else.",
                "Use a new key for a new campaign.",
            )
    return tuple(read_campaign(connection, known[key].campaign) for key in keys if key in known)


def _insert_keys(
    connection: Connection, keys: Sequence[str], asked: str, made: Sequence[Campaign]
) -> None:
    rows = [
        {"key": key, "spec_hash": asked, "campaign": campaign.id}
        for key, campaign in zip(keys, made, strict=True)
    ]
    if rows:
        connection.execute(insert(idempotency_keys), rows)


def derive_key(key: str, place: int) -> str:
    """Return the key of one campaign of a request for many; no single campaign has such a key."""
    return f"bulk-{sha256(f'{place} {key}'.encode()).hexdigest()}"


def hash_specs(specs: Sequence[CampaignSpec]) -> str:
    """Return the SHA-256 of all specs of a request, by which a repeated request is recognised."""
    return sha256("\n".join(map(spec_hash, specs)).encode()).hexdigest()
