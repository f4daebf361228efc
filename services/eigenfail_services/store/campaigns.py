"""Campaigns: how they are listed, moved from state to state, archived, and grouped in suites.

A suite consists of all campaigns with the same text before the first ": " of their names.
"""

from collections.abc import Iterator, Sequence
from typing import Any

from msgspec.structs import replace
from sqlalchemy import Connection, Row, func, select, update

from eigenfail.filters import NEWEST_FIRST, SortOrder
from eigenfail.values.campaign import (
    ANY_CAMPAIGN,
    Campaign,
    CampaignFilter,
    CampaignState,
    Overhead,
)
from eigenfail.values.campaign_spec import Priority
from eigenfail.values.operations import Versions
from eigenfail.values.records import Job, JobKind, Page
from eigenfail.values.suite import SuiteStanding
from eigenfail.versions import describe_mixed
from eigenfail_services.resolution import CampaignReferences, CheckedCampaign
from eigenfail_services.store import listing
from eigenfail_services.store.campaign_creation import (
    NewCampaign,
    create_campaigns,
    derive_key,
    request_many,
    request_one,
)
from eigenfail_services.store.campaign_rows import (
    hash_results,
    lock_campaign,
    name_campaign,
    read_campaign,
    update_campaign,
)
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.codec import OVERHEAD, to_campaign, to_json, to_references
from eigenfail_services.store.engine import StorePart
from eigenfail_services.store.events import EventSubject, append_event
from eigenfail_services.store.jobs import enqueue, fence, withdraw
from eigenfail_services.store.lifecycle import (
    MOVES,
    PHRASES,
    WITHDRAWN,
    begin_part,
    move_campaign,
    set_archived,
    set_priority,
)
from eigenfail_services.store.schema import campaigns, idempotency_keys

_NOTHING = Overhead()

CAMPAIGNS_AT_A_TIME = 500


class CampaignStore(StorePart):
    """Campaigns and their states."""

    def create(
        self, given: CheckedCampaign, idempotency_key: str | None = None, made_by: int | None = None
    ) -> Campaign:
        """Create a campaign, queued with a job; return the same one again for the same key.

        Args:
            given: the campaign.
            idempotency_key: identifies this request for ever.
            made_by: id of the API key of the request, whose quotas apply.

        Raises:
            IdempotencyMismatch: the key was used for another spec, whatever its priority.
            QuotaExceeded: the API key does not allow more.
        """
        return self.create_all([request_one(given, idempotency_key)], made_by)[0]

    def create_many(
        self,
        wanted: Sequence[CheckedCampaign],
        idempotency_key: str | None = None,
        made_by: int | None = None,
    ) -> tuple[Campaign, ...]:
        """Create campaigns in this order, all or none; return the same ones for the same key.

        Keys of `create` are not known here, and keys of this method are not known to `create`.

        Args:
            wanted: the campaigns.
            idempotency_key: identifies this request for ever.
            made_by: id of the API key of the request, whose quotas apply.

        Raises:
            IdempotencyMismatch: the key was used for another list of specs; none is created.
            QuotaExceeded: the API key does not allow all of them; none is created.
        """
        return self.create_all(request_many(wanted, idempotency_key), made_by)

    def create_all(
        self, wanted: Sequence[NewCampaign], made_by: int | None = None
    ) -> tuple[Campaign, ...]:
        """Create campaigns in this order, all or none; return those that exist for known keys.

        Args:
            wanted: the campaigns, each with its own key or without a key.
            made_by: id of the API key of the request, whose quotas apply.

        Raises:
            IdempotencyMismatch: a key was used for something else; none is created.
            QuotaExceeded: the API key does not allow all of them; none is created.
        """
        return self._database.write_once(create_campaigns, wanted, made_by)

    def is_key_used(self, idempotency_key: str | None) -> bool:
        """Return whether `create` has created a campaign with this key."""
        if idempotency_key is None:
            return False
        query = select(idempotency_keys.c.key).where(idempotency_keys.c.key == idempotency_key)
        with self._database.reading() as connection:
            return connection.execute(query).first() is not None

    def is_list_key_used(self, idempotency_key: str | None) -> bool:
        """Return whether `create_many` has created campaigns with this key."""
        return idempotency_key is not None and self.is_key_used(derive_key(idempotency_key, 0))

    def prioritise(self, campaign: int, priority: Priority) -> Campaign:
        """Set a campaign's priority, and log an event if it is another one.

        Raises:
            NotFound: no such campaign.
            IllegalTransition: the campaign has ended.
        """
        with self._database.writing() as connection:
            before = lock_campaign(connection, campaign)
            after = set_priority(before, priority)
            if after is not before:
                ours = update(campaigns).where(campaigns.c.id == campaign)
                connection.execute(ours.values(priority=priority))
                message = f"{name_campaign(after)} has the priority {priority} from now on."
                append_event(connection, "campaign.priority", message, campaign)
        return after

    def archive(self, campaign: int) -> Campaign:
        """Archive a campaign that has ended: public lists omit it, and nothing of it is deleted.

        Raises:
            NotFound: no such campaign.
            IllegalTransition: the campaign has not ended.
        """
        with self._database.writing() as connection:
            return _set_archived(connection, campaign, now_ms())

    def restore(self, campaign: int) -> Campaign:
        """List an archived campaign again; no change if it is not archived.

        Raises:
            NotFound: no such campaign.
        """
        with self._database.writing() as connection:
            return _set_archived(connection, campaign, None)

    def get(self, campaign: int) -> Campaign:
        """Return a campaign.

        Raises:
            NotFound: no such campaign.
        """
        return self._database.read(read_campaign, campaign)

    def read_references(self, campaign: int) -> CampaignReferences:
        """Return the references in a campaign's settings, as found when the campaign was created.

        Raises:
            NotFound: no such campaign.
        """
        query = select(campaigns.c.references).where(campaigns.c.id == campaign)
        with self._database.reading() as connection:
            read_campaign(connection, campaign)
            return to_references(connection.execute(query).scalar_one())

    def page(
        self,
        limit: int,
        before: int | None = None,
        where: CampaignFilter = ANY_CAMPAIGN,
        sort: SortOrder = NEWEST_FIRST,
    ) -> Page[Campaign]:
        """Return campaigns that match a filter, in an order, behind the id `before` in it.

        By id, `before` may be any number; in another order it is the id of a campaign. Among equal
        values the newest come first, and campaigns without a value last. If the value of a
        campaign changes between two pages, it may be on both of them or on none.

        Raises:
            InvalidValue: the order is not by id, and no campaign has the id `before`.
        """
        query = select(campaigns).where(*listing.filter_campaigns(where)).limit(limit + 1)
        with self._database.reading() as connection:
            query = listing.sort_campaigns(connection, query, before, sort)
            found = [to_campaign(row) for row in connection.execute(query).mappings()]
        items = tuple(found[:limit])
        return Page(items, items[-1].id if len(found) > limit else None)

    def iterate(self, where: CampaignFilter = ANY_CAMPAIGN) -> Iterator[Campaign]:
        """Yield the campaigns that match a filter, newest first; no transaction stays open."""
        return listing.iterate_items(lambda before: self.page(CAMPAIGNS_AT_A_TIME, before, where))

    def count(self, where: CampaignFilter = ANY_CAMPAIGN) -> int:
        """Return the number of campaigns that match a filter."""
        query = select(func.count()).select_from(campaigns).where(*listing.filter_campaigns(where))
        with self._database.reading() as connection:
            return connection.execute(query).scalar_one()

    def list_versioned(self, limit: int) -> tuple[Campaign, ...]:
        """Return the newest campaigns that name a version of their planner, newest first."""
        query = select(campaigns).where(campaigns.c.planner_version.is_not(None))
        query = query.order_by(campaigns.c.id.desc()).limit(limit)
        with self._database.reading() as connection:
            return tuple(to_campaign(row) for row in connection.execute(query).mappings())

    def suites(self, limit: int, before: int | None = None) -> Page[SuiteStanding]:
        """Return suites by their newest campaigns, newest first, with ids below `before`."""
        return self._database.read(_read_suites, limit, before)

    def search_suites(self, text: str, limit: int) -> tuple[str, ...]:
        """Return suites whose names contain a text in small or large letters, newest first."""
        query = (
            select(campaigns.c.suite)
            .where(listing.contains_text(campaigns.c.suite, text))
            .group_by(campaigns.c.suite)
            .order_by(func.max(campaigns.c.id).desc())
            .limit(limit)
        )
        with self._database.reading() as connection:
            return tuple(connection.execute(query).scalars())

    def move(
        self, campaign: int, to: CampaignState, because: str = "", claim: Job | None = None
    ) -> Campaign:
        """Change the state, and log the event.

        A move to `queued` queues a job; a move to a final state counts open episodes as
        cancelled and, for `done`, stores the digest.

        Args:
            campaign: id of the campaign.
            to: the new state.
            because: why, in a sentence.
            claim: claim of the service that runs the campaign; users need none.

        Raises:
            NotFound: no such campaign.
            IllegalTransition: its state does not allow it.
            ClaimLost: the claim is no longer the campaign's; nothing changes.
        """
        with self._database.writing() as connection:
            return _move_campaign(connection, campaign, to, because, claim)

    def begin_part(self, campaign: int, versions: Versions, claim: Job | None = None) -> Campaign:
        """Record the versions that the campaign goes on with; unchanged versions change nothing.

        If the campaign has results of other versions, an event says so.

        Args:
            campaign: id of the campaign.
            versions: versions by name, of what its learner runs with from now on.
            claim: claim of the service that runs the campaign.

        Raises:
            NotFound: no such campaign.
            ClaimLost: the claim is no longer the campaign's; nothing is recorded.
        """
        with self._database.writing() as connection:
            before = lock_campaign(connection, campaign)
            fence(connection, claim)
            after = begin_part(before, versions, now_ms())
            if after is not before:
                text = to_json(after.parts)
                ours = update(campaigns).where(campaigns.c.id == campaign)
                connection.execute(ours.values(parts=text))
                if after.is_mixed:
                    sentences = " ".join(describe_mixed(after)[-2:])
                    append_event(connection, "campaign.mixed_releases", sentences, campaign)
        return after

    def add_code(self, campaign: int, code: Versions) -> Campaign:
        """Record the code of a worker that ran episodes of a campaign; known code changes nothing.

        Args:
            campaign: id of the campaign.
            code: fingerprints by package.

        Raises:
            NotFound: no such campaign.
        """
        with self._database.writing() as connection:
            before = lock_campaign(connection, campaign)
            # A campaign of many workers is described by each of them, mostly in the same words.
            if code in before.code:
                return before
            after = replace(before, code=(*before.code, code))
            ours = update(campaigns).where(campaigns.c.id == campaign)
            connection.execute(ours.values(code=to_json(after.code)))
        return after

    def add_active(
        self,
        campaign: int,
        seconds: float,
        overhead: Overhead = _NOTHING,
        claim: Job | None = None,
    ) -> None:
        """Add to the running time of a campaign, and to its overhead.

        Args:
            campaign: id of the campaign.
            seconds: time that it was running. [s]
            overhead: time of learning and of waiting, and of workers whose results were discarded.
            claim: the claim that the campaign must still hold, if one is given.

        Raises:
            NotFound: no such campaign.
            ClaimLost: the claim is no longer the campaign's; nothing is added.
        """
        more = {name: campaigns.c[name] + getattr(overhead, name) for name in OVERHEAD}
        statement = (
            update(campaigns)
            .where(campaigns.c.id == campaign)
            .values(active_s=campaigns.c.active_s + seconds, **more)
        )
        with self._database.writing() as connection:
            lock_campaign(connection, campaign)
            fence(connection, claim)
            connection.execute(statement)


def _move_campaign(
    connection: Connection,
    campaign: int,
    to: CampaignState,
    because: str,
    claim: Job | None = None,
) -> Campaign:
    """Move a campaign: change its row and its job, and log an event."""
    # Every transaction locks the campaign first, its job second and the counter of events last. In
    # different orders two transactions could wait for each other.
    before = lock_campaign(connection, campaign)
    fence(connection, claim)
    after = move_campaign(before, to, because, now_ms())
    # A repeated request has no second effect: no event and no job.
    if after is before:
        return before
    if after.state is CampaignState.DONE:
        # The campaign is locked, so no result can arrive between this digest and the final state.
        after = replace(after, digest=hash_results(connection, campaign))
    update_campaign(connection, after)
    if after.state is CampaignState.QUEUED:
        enqueue(connection, JobKind.CAMPAIGN, campaign)
    if before.state is CampaignState.QUEUED and after.state in WITHDRAWN:
        withdraw(connection, JobKind.CAMPAIGN, campaign)
    message = f"{name_campaign(after)} {PHRASES[after.state]}. {because}".strip()
    append_event(connection, "campaign.state", message, campaign, EventSubject(state=after.state))
    return after


def _set_archived(connection: Connection, campaign: int, archived_ms: int | None) -> Campaign:
    before = lock_campaign(connection, campaign)
    after = set_archived(before, archived_ms)
    if after is not before:
        ours = update(campaigns).where(campaigns.c.id == campaign)
        connection.execute(ours.values(archived_ms=archived_ms))
        phrase = "is listed again" if archived_ms is None else "is archived: lists omit it"
        append_event(connection, "campaign.archive", f"{name_campaign(after)} {phrase}.", campaign)
    return after


def give_up(connection: Connection, campaign: int, because: str) -> None:
    """Move a campaign to `dead`, unless it has ended or is paused."""
    if CampaignState.DEAD in MOVES[lock_campaign(connection, campaign).state]:
        _move_campaign(connection, campaign, CampaignState.DEAD, because)


_States = dict[str, dict[CampaignState, int]]

_SUMS = ("planned", "completed", "failures")
_ALL_ERRORED = (
    campaigns.c.state == CampaignState.DONE,
    campaigns.c.completed == 0,
    campaigns.c.failed > 0,
)


def _read_suites(connection: Connection, limit: int, before: int | None) -> Page[SuiteStanding]:
    newest = func.max(campaigns.c.id)
    query = (
        select(
            campaigns.c.suite,
            newest.label("newest"),
            func.count().label("campaigns"),
            *(func.sum(campaigns.c[name]).label(name) for name in _SUMS),
            func.count().filter(*_ALL_ERRORED).label("errored"),
        )
        .where(campaigns.c.suite.is_not(None))
        .group_by(campaigns.c.suite)
        .order_by(newest.desc())
        .limit(limit + 1)
    )
    if before is not None:
        query = query.having(newest < before)
    found = connection.execute(query).all()
    states = _count_states(connection, [row.suite for row in found])
    items = tuple(_to_standing(row, states) for row in found[:limit])
    return Page(items, items[-1].newest if len(found) > limit else None)


def _count_states(connection: Connection, names: Sequence[str]) -> _States:
    query = (
        select(campaigns.c.suite, campaigns.c.state, func.count().label("n"))
        .where(campaigns.c.suite.in_(names))
        .group_by(campaigns.c.suite, campaigns.c.state)
        .order_by(campaigns.c.state)
    )
    found: _States = {name: {} for name in names}
    for row in connection.execute(query):
        found[row.suite][CampaignState(row.state)] = row.n
    return found


def _to_standing(row: Row[Any], states: _States) -> SuiteStanding:
    return SuiteStanding(
        name=row.suite,
        newest=row.newest,
        campaigns=row.campaigns,
        states=states[row.suite],
        errored=row.errored,
        # PostgreSQL returns sums of integers as Decimal.
        **{name: int(getattr(row, name)) for name in _SUMS},
    )
