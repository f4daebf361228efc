"""Suites, as a client sees them: a service finds their campaigns by name and spec."""

from collections.abc import Callable
from contextlib import suppress
from itertools import chain
from urllib.parse import quote

from eigenfail.client.campaigns import AT_REST, Campaigns
from eigenfail.client.link import Link, wait_until
from eigenfail.client.references import SuiteLike, find_suite_name
from eigenfail.errors import IllegalTransition
from eigenfail.suites import Suite, list_ready_members, make_member_key, match_campaigns
from eigenfail.values.campaign import Campaign, CampaignState
from eigenfail.values.records import Page
from eigenfail.values.rows import Rows
from eigenfail.values.seeds import SeedSpread
from eigenfail.values.suite import SuiteStanding, SuiteTable, suite_of
from eigenfail.values.summary import Summary

PAUSE_WITHIN_S = 60.0

Seen = tuple[Campaign | None, ...]
"""The campaigns of a suite's members, in order; None where there is none yet."""


class Suites:
    """Run sets of campaigns as one; finished campaigns are found and not run again.

    Every method raises ServiceUnreachable if no service answers.
    """

    def __init__(self, link: Link, campaigns: Campaigns) -> None:
        self._link = link
        self._campaigns = campaigns

    def find(self, suite: Suite) -> Seen:
        """Return the campaign of each member, in order; None if it does not exist yet."""
        found = self._found(suite)
        return tuple(found.get(member.name) for member in suite.members)

    def create(self, suite: Suite) -> Seen:
        """Queue the missing campaigns of a suite, and return each member's campaign, in order.

        None for members that build upon members that are not done: see `run`.

        Raises:
            UnknownName: a plug-in, setting or parameter that does not exist.
            InvalidValue: a value outside its bounds.
        """
        found = self._found(suite)
        made = {
            # The key follows from the spec: two commands that start a suite make each member once.
            name: self._link.post_once_only("/campaigns", Campaign, spec, make_member_key(spec))
            for name, spec in list_ready_members(suite, found)
        }
        return tuple((found | made).get(member.name) for member in suite.members)

    def start(self, suite: Suite) -> Seen:
        """Do the same as `create`, and resume paused campaigns.

        Raises:
            UnknownName: a plug-in, setting or parameter that does not exist.
            InvalidValue: a value outside its bounds.
            ServiceError: a campaign that is being paused does not come to rest.
        """
        return tuple(campaign and self._awake(campaign) for campaign in self.create(suite))

    def pause(self, suite: Suite) -> Seen:
        """Pause the campaigns that have not ended, once their running rounds are complete."""
        for campaign in self.find(suite):
            if campaign is not None and campaign.state not in AT_REST:
                with suppress(IllegalTransition):  # it ended in the meantime
                    self._campaigns.pause(campaign.id)
        return self.find(suite)

    def wait(
        self,
        suite: Suite,
        on_progress: Callable[[Seen], None] | None = None,
        poll_s: float = 0.3,
        timeout_s: float | None = None,
    ) -> Seen:
        """Wait until all campaigns of a suite have ended or are paused, and return them.

        Args:
            suite: the suite.
            on_progress: called with each campaign after every poll, including the last.
            poll_s: time between two polls.
            timeout_s: time limit; None waits forever.

        Raises:
            WaitTimeout: they did not end in time; they continue to run.
        """
        look = telling(lambda: self.find(suite), on_progress)
        return wait_until(look, are_at_rest, poll_s, timeout_s, _describe_rest)

    def run(
        self,
        suite: Suite,
        on_progress: Callable[[Seen], None] | None = None,
        poll_s: float = 0.3,
        timeout_s: float | None = None,
    ) -> Seen:
        """Run a suite and wait; dependents start once the members they build upon are done.

        If a campaign is cancelled, dead or paused by a user, its dependents are not created.

        Args:
            suite: the suite.
            on_progress: called with each campaign after every poll, including the last.
            poll_s: time between two polls.
            timeout_s: time limit; None waits forever.

        Raises:
            UnknownName: a plug-in, setting or parameter that does not exist.
            InvalidValue: a value outside its bounds.
            WaitTimeout: they did not end in time; they continue to run.
        """
        self.start(suite)
        look = telling(lambda: self.create(suite), on_progress)
        return wait_until(look, are_at_rest, poll_s, timeout_s, _describe_rest)

    def summaries(self, suite: Suite) -> tuple[Summary | None, ...]:
        """Return each member's findings so far, in order; None if its campaign is missing."""
        return tuple(
            self._campaigns.summary(campaign.id) if campaign else None
            for campaign in self.find(suite)
        )

    def over_seeds(self, suite: Suite) -> tuple[SeedSpread, ...]:
        """Return mean and spread of each group of members that differ only in their seeds."""
        ids = [campaign.id for campaign in self.find(suite) if campaign]
        return self._campaigns.over_seeds(ids) if suite.has_seeds and ids else ()

    def list(self) -> Rows[SuiteStanding]:
        """List all suites that have campaigns, those with the newest campaigns first."""
        return self._link.pages("/suites", Page[SuiteStanding], "before")

    def table(self, suite: SuiteLike) -> SuiteTable:
        """Return the newest campaign of each member of a suite, and their differing settings.

        Args:
            suite: the suite, or its name.

        Raises:
            NotFound: no campaign belongs to such a suite.
        """
        return self._link.get(f"/suites/{quote(find_suite_name(suite), safe='')}", SuiteTable)

    def _found(self, suite: Suite) -> dict[str, Campaign]:
        """Return the existing campaigns of members, by the members' names."""
        alike: dict[str, list[Campaign]] = {member.spec.name: [] for member in suite.members}
        named = dict.fromkeys(suite_of(name) for name in alike)
        # An archived member has its results: it is not run again.
        listed = (self._campaigns.list(suite=name, archived=True) for name in named)
        for campaign in chain.from_iterable(listed):
            if campaign.spec.name in alike:
                alike[campaign.spec.name].append(campaign)
                # Lists begin with the newest: older campaigns need not be read once all are found.
                found = match_campaigns(suite, alike) if all(alike.values()) else {}
                if len(found) == len(alike):
                    return found
        return match_campaigns(suite, alike)

    def _awake(self, campaign: Campaign) -> Campaign:
        # A campaign that is pausing cannot be resumed: its rounds at work come in first.
        if campaign.state is CampaignState.PAUSING:
            campaign = self._campaigns.wait(campaign.id, timeout_s=PAUSE_WITHIN_S)
        is_paused = campaign.state is CampaignState.PAUSED
        return self._campaigns.resume(campaign.id) if is_paused else campaign


def telling(
    see: Callable[[], Seen], on_progress: Callable[[Seen], None] | None
) -> Callable[[], Seen]:
    """Return a function that returns what `see` returns, and also reports it if possible."""

    def look() -> Seen:
        seen = see()
        if on_progress is not None:
            on_progress(seen)
        return seen

    return look


def _describe_rest(campaigns: Seen) -> str:
    ended = sum(campaign is not None and campaign.state in AT_REST for campaign in campaigns)
    return f"The suite ({ended} of {len(campaigns)} campaigns ended or paused)"


def are_at_rest(campaigns: Seen) -> bool:
    """Return whether no campaign is running or queued."""
    return all(campaign is None or campaign.state in AT_REST for campaign in campaigns)
