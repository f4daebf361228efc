"""Campaigns in SQL."""

from msgspec.structs import replace
from sqlalchemy import Connection, insert, select, update
from sqlalchemy.exc import IntegrityError

from eigenfail.values import Campaign, CampaignSpec, CampaignState, Overhead, Page
from eigenfail.values.records import JobKind
from eigenfail_services.campaigns.lifecycle import MOVES, WITHDRAWN, moved
from eigenfail_services.store import sentences
from eigenfail_services.store.campaign_rows import add, locked, one, write
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.codec import OVERHEAD, spec_hash, to_campaign
from eigenfail_services.store.engine import Database
from eigenfail_services.store.episodes import digest
from eigenfail_services.store.events import append
from eigenfail_services.store.jobs import enqueue, withdraw
from eigenfail_services.store.refusals import key_used, no_campaign
from eigenfail_services.store.schema import campaigns, idempotency_keys

NOTHING = Overhead()


class SqlCampaigns:
    """Campaigns and their life."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def create(self, spec: CampaignSpec, idempotency_key: str | None = None) -> Campaign:
        """A new campaign, queued with a job for it; the same one again for the same key."""
        try:
            return self._create(spec, idempotency_key)
        except IntegrityError:
            # Somebody else used the key at the same time: now theirs can be seen.
            return self._create(spec, idempotency_key)

    def _create(self, spec: CampaignSpec, key: str | None) -> Campaign:
        with self._database.writing() as connection:
            if key is not None and (earlier := _created_with(connection, key, spec)):
                return earlier
            campaign = add(connection, spec)
            if key is not None:
                connection.execute(
                    insert(idempotency_keys).values(
                        key=key, spec_hash=spec_hash(spec), campaign=campaign.id
                    )
                )
            enqueue(connection, JobKind.CAMPAIGN, campaign.id)
            append(
                connection, "campaign.created", sentences.campaign_created(campaign), campaign.id
            )
        return campaign

    def get(self, campaign: int) -> Campaign:
        """The campaign as it stands."""
        with self._database.reading() as connection:
            return one(connection, campaign)

    def page(
        self, limit: int, before: int | None = None, state: CampaignState | None = None
    ) -> Page[Campaign]:
        """Campaigns, newest first, with ids below `before`."""
        query = select(campaigns).order_by(campaigns.c.id.desc()).limit(limit + 1)
        if before is not None:
            query = query.where(campaigns.c.id < before)
        if state is not None:
            query = query.where(campaigns.c.state == state)
        with self._database.reading() as connection:
            found = [to_campaign(row) for row in connection.execute(query).mappings()]
        items = tuple(found[:limit])
        return Page(items, items[-1].id if len(found) > limit else None)

    def move(self, campaign: int, to: CampaignState, because: str = "") -> Campaign:
        """Change the state, and log the event."""
        with self._database.writing() as connection:
            return change(connection, campaign, to, because)

    def add_active(self, campaign: int, seconds: float, overhead: Overhead = NOTHING) -> None:
        """Add to the time during which the campaign was running, and to what that went into."""
        # Where nobody measured from the beginning on, NULL + x stays NULL.
        more = {name: campaigns.c[name] + getattr(overhead, name) for name in OVERHEAD}
        statement = (
            update(campaigns)
            .where(campaigns.c.id == campaign)
            .values(active_s=campaigns.c.active_s + seconds, **more)
        )
        with self._database.writing() as connection:
            if not connection.execute(statement).rowcount:
                raise no_campaign(campaign)


def change(connection: Connection, campaign: int, to: CampaignState, because: str) -> Campaign:
    """Move a campaign: its row, its job, its event."""
    before = locked(connection, campaign)
    after = moved(before, to, because, now_ms())
    if after is before:
        return before
    if after.state is CampaignState.DONE:
        after = replace(after, digest=digest(connection, campaign))
    write(connection, after)
    if after.state is CampaignState.QUEUED:
        enqueue(connection, JobKind.CAMPAIGN, campaign)
    if before.state is CampaignState.QUEUED and after.state in WITHDRAWN:
        withdraw(connection, JobKind.CAMPAIGN, campaign)
    append(connection, "campaign.state", sentences.campaign_moved(after, because), campaign)
    return after


def give_up(connection: Connection, campaign: int, because: str) -> None:
    """Let a campaign die, unless it has ended or rests."""
    if CampaignState.DEAD in MOVES[locked(connection, campaign).state]:
        change(connection, campaign, CampaignState.DEAD, because)


def _created_with(connection: Connection, key: str, spec: CampaignSpec) -> Campaign | None:
    found = connection.execute(
        select(idempotency_keys).where(idempotency_keys.c.key == key)
    ).one_or_none()
    if found is None:
        return None
    if found.spec_hash != spec_hash(spec):
        raise key_used(found.campaign)
    return one(connection, found.campaign)
