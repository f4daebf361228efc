"""What remembers campaigns and their life."""

from collections.abc import Sequence
from typing import Protocol

from eigenfail.values import Campaign, CampaignSpec, CampaignState, Overhead, Page, Priority
from eigenfail.values.campaign_filter import ANY_CAMPAIGN, CampaignFilter
from eigenfail.values.records import Job
from eigenfail.values.suite import SuiteStanding

NOTHING = Overhead()


class CampaignStore(Protocol):
    """Campaigns and their life."""

    def create(
        self, spec: CampaignSpec, idempotency_key: str | None = None, made_by: int | None = None
    ) -> Campaign:
        """A new campaign, queued with a job for it; the same one again for the same key.

        Args:
            spec: what is asked for.
            idempotency_key: what tells this request from others, for ever.
            made_by: id of the key of whoever asks; what counts against its quotas.

        Raises:
            IdempotencyMismatch: the key was used for another spec, whatever its priority.
            QuotaExceeded: the key of whoever asks does not allow more.
        """

    def create_many(
        self,
        specs: Sequence[CampaignSpec],
        idempotency_key: str | None = None,
        made_by: int | None = None,
    ) -> tuple[Campaign, ...]:
        """New campaigns in this order, all of them or none; the same ones again for the same key.

        Keys of single campaigns are not known here, nor these there.

        Raises:
            IdempotencyMismatch: the key was used for another list of specs; none is new.
            QuotaExceeded: the key of whoever asks does not allow all of them; none is new.
        """

    def prioritise(self, campaign: int, priority: Priority) -> Campaign:
        """Give it another priority from now on, and log the event; the same again is no event.

        Raises:
            NotFound: no such campaign.
            IllegalTransition: it has ended.
        """

    def get(self, campaign: int) -> Campaign:
        """The campaign as it stands.

        Raises:
            NotFound: no such campaign.
        """

    def page(
        self,
        limit: int,
        before: int | None = None,
        state: CampaignState | None = None,
        suite: str | None = None,
        where: CampaignFilter = ANY_CAMPAIGN,
    ) -> Page[Campaign]:
        """Campaigns, newest first, with ids below `before`; of one state, of one suite."""

    def suites(self, limit: int, before: int | None = None) -> Page[SuiteStanding]:
        """Suites by their newest campaigns, newest first, of those with ids below `before`."""

    def move(
        self, campaign: int, to: CampaignState, because: str = "", claim: Job | None = None
    ) -> Campaign:
        """Change the state, and log the event.

        A move to `queued` queues a job; a move to a final state counts what is still open as
        cancelled and, for `done`, stores the digest.

        Args:
            campaign: by its id.
            to: the new state.
            because: why, in a sentence.
            claim: of who runs the campaign; users need none.

        Raises:
            NotFound: no such campaign.
            IllegalTransition: its state does not allow it.
            ClaimLost: the claim is no longer the campaign's; nothing changes.
        """

    def add_active(
        self,
        campaign: int,
        seconds: float,
        overhead: Overhead = NOTHING,
        claim: Job | None = None,
    ) -> None:
        """Add to the time during which the campaign was running, and to what that went into.

        The overhead of a campaign of which an older release did not measure it stays unknown.

        Raises:
            NotFound: no such campaign.
            ClaimLost: the claim is no longer the campaign's; nothing is added.
        """
