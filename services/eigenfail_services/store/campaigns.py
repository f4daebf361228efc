"""Campaigns in SQL."""

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

from msgspec.structs import replace
from sqlalchemy import ColumnElement, Connection, func, select, update
from sqlalchemy.exc import IntegrityError

from eigenfail.values import Campaign, CampaignSpec, CampaignState, Overhead, Page, Priority
from eigenfail.values.campaign_filter import ANY_CAMPAIGN, CampaignFilter
from eigenfail.values.records import Job, JobKind
from eigenfail.values.suite import SuiteStanding
from eigenfail_services.campaigns.lifecycle import MOVES, WITHDRAWN, moved, prioritised
from eigenfail_services.store import sentences
from eigenfail_services.store.campaign_rows import locked, one, write
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.codec import OVERHEAD, to_campaign
from eigenfail_services.store.creation import create, create_many
from eigenfail_services.store.engine import Database
from eigenfail_services.store.episodes import digest
from eigenfail_services.store.events import append
from eigenfail_services.store.jobs import enqueue, withdraw
from eigenfail_services.store.leases import fence
from eigenfail_services.store.schema import campaigns
from eigenfail_services.store.spec_fields import spec_field
from eigenfail_services.store.suites import suites_page

NOTHING = Overhead()

Asked = TypeVar("Asked")
Made = TypeVar("Made")
Maker = Callable[[Connection, Asked, str | None, int | None], Made]


class SqlCampaigns:
    """Campaigns and their life."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def create(
        self, spec: CampaignSpec, idempotency_key: str | None = None, made_by: int | None = None
    ) -> Campaign:
        """A new campaign, queued with a job for it; the same one again for the same key."""
        return self._once(create, spec, idempotency_key, made_by)

    def create_many(
        self,
        specs: Sequence[CampaignSpec],
        idempotency_key: str | None = None,
        made_by: int | None = None,
    ) -> tuple[Campaign, ...]:
        """New campaigns, all or none; the same ones again for the same key."""
        return self._once(create_many, specs, idempotency_key, made_by)

    def _once(
        self, make: Maker[Asked, Made], asked: Asked, key: str | None, made_by: int | None
    ) -> Made:
        try:
            with self._database.writing() as connection:
                return make(connection, asked, key, made_by)
        except IntegrityError:
            # Somebody else used the key at the same time: now theirs can be seen.
            with self._database.writing() as connection:
                return make(connection, asked, key, made_by)

    def prioritise(self, campaign: int, priority: Priority) -> Campaign:
        """Give it another priority from now on, and log the event."""
        with self._database.writing() as connection:
            return prioritise(connection, campaign, priority)

    def get(self, campaign: int) -> Campaign:
        """The campaign as it stands."""
        with self._database.reading() as connection:
            return one(connection, campaign)

    def page(
        self,
        limit: int,
        before: int | None = None,
        state: CampaignState | None = None,
        suite: str | None = None,
        where: CampaignFilter = ANY_CAMPAIGN,
    ) -> Page[Campaign]:
        """Campaigns, newest first, with ids below `before`; of one state, of one suite."""
        query = select(campaigns).order_by(campaigns.c.id.desc()).limit(limit + 1)
        if before is not None:
            query = query.where(campaigns.c.id < before)
        if state is not None:
            query = query.where(campaigns.c.state == state)
        if suite is not None:
            query = query.where(campaigns.c.suite == suite)
        query = query.where(*fulfilled(where))
        with self._database.reading() as connection:
            found = [to_campaign(row) for row in connection.execute(query).mappings()]
        items = tuple(found[:limit])
        return Page(items, items[-1].id if len(found) > limit else None)

    def suites(self, limit: int, before: int | None = None) -> Page[SuiteStanding]:
        """Suites by their newest campaigns, newest first, of those with ids below `before`."""
        with self._database.reading() as connection:
            return suites_page(connection, limit, before)

    def move(
        self, campaign: int, to: CampaignState, because: str = "", claim: Job | None = None
    ) -> Campaign:
        """Change the state, and log the event."""
        with self._database.writing() as connection:
            return change(connection, campaign, to, because, claim)

    def add_active(
        self,
        campaign: int,
        seconds: float,
        overhead: Overhead = NOTHING,
        claim: Job | None = None,
    ) -> None:
        """Add to the time during which the campaign was running, and to what that went into."""
        # Where nobody measured from the beginning on, NULL + x stays NULL.
        more = {name: campaigns.c[name] + getattr(overhead, name) for name in OVERHEAD}
        statement = (
            update(campaigns)
            .where(campaigns.c.id == campaign)
            .values(active_s=campaigns.c.active_s + seconds, **more)
        )
        with self._database.writing() as connection:
            locked(connection, campaign)
            fence(connection, claim)
            connection.execute(statement)


def fulfilled(where: CampaignFilter) -> Iterator[ColumnElement[bool]]:
    """The conditions of a filter."""
    if where.method is not None:
        yield spec_field("method") == where.method
    if where.besides is not None:
        yield spec_field("method") != where.besides
    if where.search is not None:
        words = where.search.lower().replace("\x00", "�")  # which no database takes
        yield func.lower(spec_field("name")).contains(words, autoescape=True)


def change(
    connection: Connection,
    campaign: int,
    to: CampaignState,
    because: str,
    claim: Job | None = None,
) -> Campaign:
    """Move a campaign: its row, its job, its event."""
    before = locked(connection, campaign)
    fence(connection, claim)
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


def prioritise(connection: Connection, campaign: int, priority: Priority) -> Campaign:
    """Give a campaign another priority: its row, its event."""
    before = locked(connection, campaign)
    after = prioritised(before, priority)
    if after is not before:
        connection.execute(
            update(campaigns).where(campaigns.c.id == campaign).values(priority=priority)
        )
        append(connection, "campaign.priority", sentences.campaign_prioritised(after), campaign)
    return after


def give_up(connection: Connection, campaign: int, because: str) -> None:
    """Let a campaign die, unless it has ended or rests."""
    if CampaignState.DEAD in MOVES[locked(connection, campaign).state]:
        change(connection, campaign, CampaignState.DEAD, because)
