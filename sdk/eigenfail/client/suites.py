"""Suites, as a client sees them: a service knows their campaigns, by name and spec."""

from collections.abc import Callable
from contextlib import suppress
from hashlib import sha256

import msgspec

from eigenfail.client.campaigns import AT_REST, Campaigns
from eigenfail.client.link import Link
from eigenfail.client.waiting import wait_until
from eigenfail.errors import IllegalTransition
from eigenfail.suites import Member, Suite
from eigenfail.values import Campaign, CampaignSpec, CampaignState, Summary

PAUSE_WITHIN_S = 60.0


class Suites:
    """Run sets of campaigns as one; whatever was done before is found, never done twice.

    Every method raises ServiceUnreachable if no service answers.
    """

    def __init__(self, link: Link, campaigns: Campaigns) -> None:
        self._link = link
        self._campaigns = campaigns

    def find(self, suite: Suite) -> tuple[Campaign | None, ...]:
        """The campaign of each member, in order; None where there is none yet."""
        missing = {member.spec.name: member.spec for member in suite.members}
        found: dict[str, Campaign] = {}
        for campaign in self._campaigns.list():
            name = campaign.spec.name
            if campaign.spec == missing.get(name):
                found[name] = campaign
                del missing[name]
            if not missing:
                break
        return tuple(found.get(member.spec.name) for member in suite.members)

    def create(self, suite: Suite) -> tuple[Campaign, ...]:
        """The campaign of each member, in order; those that are missing are queued.

        Raises:
            UnknownName: a plug-in, setting or parameter that does not exist.
            InvalidValue: a value outside its bounds.
        """
        found = zip(suite.members, self.find(suite), strict=True)
        return tuple(campaign or self._created(member) for member, campaign in found)

    def start(self, suite: Suite) -> tuple[Campaign, ...]:
        """The same, and those that are paused go on.

        Raises:
            UnknownName: a plug-in, setting or parameter that does not exist.
            InvalidValue: a value outside its bounds.
            ServiceError: one that is being paused does not come to rest.
        """
        return tuple(self._awake(campaign) for campaign in self.create(suite))

    def pause(self, suite: Suite) -> tuple[Campaign | None, ...]:
        """Let those that have not ended rest once their rounds at work are in."""
        for campaign in self.find(suite):
            if campaign is not None and campaign.state not in AT_REST:
                with suppress(IllegalTransition):  # it ended in the meantime
                    self._campaigns.pause(campaign.id)
        return self.find(suite)

    def wait(
        self,
        suite: Suite,
        on_progress: Callable[[tuple[Campaign | None, ...]], None] | None = None,
        poll_s: float = 0.3,
        timeout_s: float | None = None,
    ) -> tuple[Campaign | None, ...]:
        """The campaigns once all that exist have ended or are paused.

        Args:
            suite: whose campaigns.
            on_progress: told of them at every look, the last one included.
            poll_s: time between two looks.
            timeout_s: give up after this time; None waits for ever.

        Raises:
            ServiceError: they did not end in time; they go on all the same.
        """

        def look() -> tuple[Campaign | None, ...]:
            seen = self.find(suite)
            if on_progress is not None:
                on_progress(seen)
            return seen

        return wait_until(look, are_at_rest, poll_s, timeout_s)

    def summaries(self, suite: Suite) -> tuple[Summary | None, ...]:
        """What each member found so far, in order; None where there is no campaign yet."""
        return tuple(
            self._campaigns.summary(campaign.id) if campaign else None
            for campaign in self.find(suite)
        )

    def _created(self, member: Member) -> Campaign:
        key = key_of(member.spec)
        return self._link.post_once_only("/campaigns", Campaign, member.spec, key)

    def _awake(self, campaign: Campaign) -> Campaign:
        if campaign.state is CampaignState.PAUSING:
            campaign = self._campaigns.wait(campaign.id, timeout_s=PAUSE_WITHIN_S)
        is_paused = campaign.state is CampaignState.PAUSED
        return self._campaigns.resume(campaign.id) if is_paused else campaign


def are_at_rest(campaigns: tuple[Campaign | None, ...]) -> bool:
    """Whether none is at work, or about to be."""
    return all(campaign is None or campaign.state in AT_REST for campaign in campaigns)


def key_of(spec: CampaignSpec) -> str:
    """One key for one member of one suite: both names are in the spec, and its whole content."""
    return f"suite-{sha256(msgspec.json.encode(spec, order='sorted')).hexdigest()}"
