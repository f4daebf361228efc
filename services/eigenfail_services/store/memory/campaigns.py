"""Campaigns in memory."""

from collections.abc import Sequence

from msgspec.structs import replace

from eigenfail.values import (
    Campaign,
    CampaignSpec,
    CampaignState,
    Counts,
    Overhead,
    Page,
    Priority,
)
from eigenfail.values.campaign_filter import ANY_CAMPAIGN, CampaignFilter
from eigenfail.values.records import Job, JobKind
from eigenfail.values.suite import SuiteStanding, suite_of
from eigenfail_services.campaigns.lifecycle import MOVES, WITHDRAWN, moved, prioritised
from eigenfail_services.store import sentences
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.memory.episodes import digest
from eigenfail_services.store.memory.quotas import admit
from eigenfail_services.store.memory.retention import refuse_gone
from eigenfail_services.store.memory.suites import suites_page
from eigenfail_services.store.memory.tables import Tables
from eigenfail_services.store.refusals import key_used

NOTHING = Overhead()


class MemoryCampaigns:
    """Campaigns and their life."""

    def __init__(self, tables: Tables) -> None:
        self._tables = tables

    def create(
        self, spec: CampaignSpec, idempotency_key: str | None = None, made_by: int | None = None
    ) -> Campaign:
        """A new campaign, queued with a job for it; the same one again for the same key."""
        with self._tables.lock:
            if idempotency_key is not None and idempotency_key in self._tables.keys:
                return self._earlier(self._tables.keys[idempotency_key], spec)
            refuse_gone(self._tables, [spec])
            admit(self._tables, made_by, [spec])
            campaign = self._add(spec, made_by)
            if idempotency_key is not None:
                self._tables.keys[idempotency_key] = campaign.id
            return campaign

    def create_many(
        self,
        specs: Sequence[CampaignSpec],
        idempotency_key: str | None = None,
        made_by: int | None = None,
    ) -> tuple[Campaign, ...]:
        """New campaigns, all or none; the same ones again for the same key."""
        with self._tables.lock:
            earlier = self._tables.batches.get(idempotency_key or "", ())
            found = tuple(map(self._tables.campaign, earlier))
            if found and not alike(found, specs):
                raise key_used(earlier[0])
            if not found:
                refuse_gone(self._tables, specs)
                admit(self._tables, made_by, specs)
            made = found or tuple(self._add(spec, made_by) for spec in specs)
            if idempotency_key is not None:
                self._tables.batches[idempotency_key] = tuple(each.id for each in made)
            return made

    def _earlier(self, number: int, spec: CampaignSpec) -> Campaign:
        earlier = self._tables.campaign(number)
        if not earlier.spec.is_like(spec):
            raise key_used(number)
        return earlier

    def _add(self, spec: CampaignSpec, made_by: int | None) -> Campaign:
        campaign = Campaign(
            id=len(self._tables.campaigns) + 1,
            spec=spec,
            state=CampaignState.QUEUED,
            counts=Counts(spec.episodes),
            created_ms=now_ms(),
            overhead=Overhead(),
        )
        self._tables.campaigns[campaign.id] = campaign
        self._tables.episodes[campaign.id] = {}
        if made_by is not None:
            self._tables.made_by[campaign.id] = made_by
        self._tables.enqueue(JobKind.CAMPAIGN, campaign.id)
        self._tables.log("campaign.created", sentences.campaign_created(campaign), campaign.id)
        return campaign

    def prioritise(self, campaign: int, priority: Priority) -> Campaign:
        """Give it another priority from now on, and log the event."""
        with self._tables.lock:
            before = self._tables.campaign(campaign)
            after = prioritised(before, priority)
            if after is not before:
                self._tables.campaigns[campaign] = after
                told = sentences.campaign_prioritised(after)
                self._tables.log("campaign.priority", told, campaign)
            return after

    def get(self, campaign: int) -> Campaign:
        """The campaign as it stands."""
        with self._tables.lock:
            return self._tables.campaign(campaign)

    def page(
        self,
        limit: int,
        before: int | None = None,
        state: CampaignState | None = None,
        suite: str | None = None,
        where: CampaignFilter = ANY_CAMPAIGN,
    ) -> Page[Campaign]:
        """Campaigns, newest first, with ids below `before`; of one state, of one suite."""
        with self._tables.lock:
            found = [
                campaign
                for number, campaign in reversed(self._tables.campaigns.items())
                if (before is None or number < before)
                and state in {None, campaign.state}
                and suite in {None, suite_of(campaign.spec.name)}
                and where.method in {None, campaign.spec.method}
                and where.besides != campaign.spec.method
                and (where.search or "").lower() in campaign.spec.name.lower()
            ]
        return Page(tuple(found[:limit]), found[limit - 1].id if len(found) > limit else None)

    def suites(self, limit: int, before: int | None = None) -> Page[SuiteStanding]:
        """Suites by their newest campaigns, newest first, of those with ids below `before`."""
        with self._tables.lock:
            return suites_page(self._tables.campaigns.values(), limit, before)

    def move(
        self, campaign: int, to: CampaignState, because: str = "", claim: Job | None = None
    ) -> Campaign:
        """Change the state, and log the event."""
        with self._tables.lock:
            before = self._tables.campaign(campaign)
            self._tables.fence(claim)
            after = moved(before, to, because, now_ms())
            if after is before:
                return before
            if after.state is CampaignState.DONE:
                after = replace(after, digest=digest(self._tables, campaign))
            self._tables.campaigns[campaign] = after
            if after.state is CampaignState.QUEUED:
                self._tables.enqueue(JobKind.CAMPAIGN, campaign)
            if before.state is CampaignState.QUEUED and after.state in WITHDRAWN:
                self._tables.withdraw(JobKind.CAMPAIGN, campaign)
            self._tables.log("campaign.state", sentences.campaign_moved(after, because), campaign)
            return after

    def give_up(self, campaign: int, because: str) -> None:
        """Let a campaign die, unless it has ended or rests."""
        with self._tables.lock:
            if CampaignState.DEAD in MOVES[self._tables.campaign(campaign).state]:
                self.move(campaign, CampaignState.DEAD, because)

    def add_active(
        self,
        campaign: int,
        seconds: float,
        overhead: Overhead = NOTHING,
        claim: Job | None = None,
    ) -> None:
        """Add to the time during which the campaign was running, and to what that went into."""
        with self._tables.lock:
            before = self._tables.campaign(campaign)
            self._tables.fence(claim)
            self._tables.campaigns[campaign] = replace(
                before,
                active_s=before.active_s + seconds,
                overhead=before.overhead and added(before.overhead, overhead),
            )


def alike(made: Sequence[Campaign], specs: Sequence[CampaignSpec]) -> bool:
    """Whether these are the campaigns that were asked for, at whatever priorities."""
    pairs = zip(made, specs, strict=False)
    return len(made) == len(specs) and all(each.spec.is_like(spec) for each, spec in pairs)


def added(one: Overhead, other: Overhead) -> Overhead:
    """Both together."""
    return Overhead(
        one.learning_s + other.learning_s,
        one.waiting_s + other.waiting_s,
        one.discarded_s + other.discarded_s,
    )
