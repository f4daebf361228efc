"""Creation of campaigns: a request that is repeated with its key creates them only once."""

from collections.abc import Sequence
from hashlib import sha256

import msgspec
from sqlalchemy import Connection, insert, select

from eigenfail.errors import IdempotencyMismatch
from eigenfail.values.campaign import Campaign
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.records import JobKind
from eigenfail_services.resolution import CheckedCampaign
from eigenfail_services.store.access import admit_campaigns
from eigenfail_services.store.campaign_rows import insert_campaign, name_campaign, read_campaign
from eigenfail_services.store.codec import spec_hash
from eigenfail_services.store.events import append_event
from eigenfail_services.store.jobs import enqueue
from eigenfail_services.store.retention import hold_noise, refuse_pruned
from eigenfail_services.store.schema import idempotency_keys


class NewCampaign(msgspec.Struct, frozen=True):
    """A campaign to be created.

    Attributes:
        checked: its spec, with the findings of its check.
        key: idempotency key, which lets it be created only once; None without one.
        asked: SHA-256 of the content of the request with the key.
    """

    checked: CheckedCampaign
    key: str | None
    asked: str


def request_one(wanted: CheckedCampaign, key: str | None = None) -> NewCampaign:
    """Return the new campaign of a request for one campaign."""
    return NewCampaign(wanted, key, spec_hash(wanted.spec))


def request_many(wanted: Sequence[CheckedCampaign], key: str | None) -> list[NewCampaign]:
    """Return the new campaigns of a request for a list."""
    # The hash is of the whole list: a list that only begins alike is another request.
    asked = hash_specs([each.spec for each in wanted])
    return [
        NewCampaign(each, key and derive_key(key, place), asked)
        for place, each in enumerate(wanted)
    ]


def create_campaigns(
    connection: Connection, wanted: Sequence[NewCampaign], made_by: int | None
) -> tuple[Campaign, ...]:
    """Create campaigns in their order, all or none; return those that their keys have created."""
    earlier = _find_made(connection, wanted)
    found = [earlier.get(each.key or "") for each in wanted]
    missing = [each for each, known in zip(wanted, found, strict=True) if known is None]
    made = iter(_insert_queued(connection, missing, made_by) if missing else ())
    return tuple(known or next(made) for known in found)


def _insert_queued(
    connection: Connection, wanted: Sequence[NewCampaign], made_by: int | None
) -> tuple[Campaign, ...]:
    """Create campaigns with their keys, their jobs and their events.

    Raises:
        QuotaExceeded: the key's quota of campaigns or episodes would be exceeded.
        NoisePruned: a spec names an episode whose noise was pruned.
    """
    # The noise is held before it is checked: a pruning between the two steps would go unnoticed.
    campaigns = [each.checked for each in wanted]
    references = [each.references for each in campaigns]
    if needed := frozenset[int]().union(*(each.noise_sources for each in references)):
        hold_noise(connection, needed)
    for each in references:
        refuse_pruned(connection, each.noise)
    admit_campaigns(connection, made_by, [each.spec for each in campaigns])
    made = tuple(insert_campaign(connection, each, made_by) for each in campaigns)
    keys = [
        {"key": each.key, "spec_hash": each.asked, "campaign": campaign.id}
        for each, campaign in zip(wanted, made, strict=True)
        if each.key is not None
    ]
    if keys:
        connection.execute(insert(idempotency_keys), keys)
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


def _find_made(connection: Connection, wanted: Sequence[NewCampaign]) -> dict[str, Campaign]:
    """Return the campaigns that the keys have created, by their keys.

    Raises:
        IdempotencyMismatch: one was created by a request for something else.
    """
    asked = {each.key: each.asked for each in wanted if each.key is not None}
    if not asked:
        return {}
    query = select(idempotency_keys).where(idempotency_keys.c.key.in_(asked))
    known = connection.execute(query).all()
    for row in known:
        # Returning the earlier campaign would hide that this request has created nothing.
        if row.spec_hash != asked[row.key]:
            raise IdempotencyMismatch(
                f"This Idempotency-Key was used for campaign {row.campaign}, which asks for "
                "something else.",
                "Use a new key for a new campaign.",
            )
    return {row.key: read_campaign(connection, row.campaign) for row in known}


def derive_key(key: str, place: int) -> str:
    """Return the key of one campaign of a request for many; no single campaign has such a key."""
    return f"bulk-{sha256(f'{place} {key}'.encode()).hexdigest()}"


def hash_specs(specs: Sequence[CampaignSpec]) -> str:
    """Return the SHA-256 of all specs of a request, which identifies a repeated request."""
    return sha256("\n".join(map(spec_hash, specs)).encode()).hexdigest()
