"""Suites, as a client sees them: a service knows their campaigns, by name and spec."""

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
    """Run sets of campaigns as one; finished campaigns are found, and never run twice.

    Every method raises ServiceUnreachable if no service answers.
    """

    def __init__(self, link: Link, campaigns: Campaigns) -> None:
        self._link = link
        self._campaigns = campaigns

    def find(self, suite: Suite) -> Seen:
        """The campaign of each member, in order; None if there is none yet."""
        found = self._found(suite)
        return tuple(found.get(member.name) for member in suite.members)

    def create(self, suite: Suite) -> Seen:
        """The campaign of each member, in order; those that are missing are queued.

        None for those that build upon members that are not done: see `run`.

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
        """The same, and those that are paused go on.

        Raises:
            UnknownName: a plug-in, setting or parameter that does not exist.
            InvalidValue: a value outside its bounds.
            ServiceError: one that is being paused does not come to rest.
        """
        return tuple(campaign and self._awake(campaign) for campaign in self.create(suite))

    def pause(self, suite: Suite) -> Seen:
        """Let those that have not ended rest once their rounds at work are in."""
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
        """Return the campaigns once all of them have ended or are paused.

        Args:
            suite: whose campaigns.
            on_progress: called with each campaign after every poll, the last one included.
            poll_s: time between two looks.
            timeout_s: give up after this time; None waits for ever.

        Raises:
            WaitTimeout: they did not end in time; they go on all the same.
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
        """Start all of a suite, members that build upon others once these are done, and wait.

        If one of those is cancelled or dead, or was paused by a user, there is no campaign of a
        member that builds upon it.

        Args:
            suite: whose campaigns.
            on_progress: called with each campaign after every poll, the last one included.
            poll_s: time between two looks.
            timeout_s: give up after this time; None waits for ever.

        Raises:
            UnknownName: a plug-in, setting or parameter that does not exist.
            InvalidValue: a value outside its bounds.
            WaitTimeout: they did not end in time; they go on all the same.
        """
        self.start(suite)
        look = telling(lambda: self.create(suite), on_progress)
        return wait_until(look, are_at_rest, poll_s, timeout_s, _describe_rest)

    def summaries(self, suite: Suite) -> tuple[Summary | None, ...]:
        """The findings of each member so far, in order; None if there is no campaign yet."""
        return tuple(
            self._campaigns.summary(campaign.id) if campaign else None
            for campaign in self.find(suite)
        )

    def over_seeds(self, suite: Suite) -> tuple[SeedSpread, ...]:
        """Mean and spread of the members that differ in their seeds alone, group by group."""
        ids = [campaign.id for campaign in self.find(suite) if campaign]
        return self._campaigns.over_seeds(ids) if suite.has_seeds and ids else ()

    def list(self) -> Rows[SuiteStanding]:
        """All suites that have campaigns, those with the newest ones first."""
        return self._link.pages("/suites", Page[SuiteStanding], "before")

    def table(self, suite: SuiteLike) -> SuiteTable:
        """The newest campaign of each member of a suite, and what differs between them.

        Args:
            suite: the suite, or its name.

        Raises:
            NotFound: no campaign belongs to such a suite.
        """
        return self._link.get(f"/suites/{quote(find_suite_name(suite), safe='')}", SuiteTable)

    def _found(self, suite: Suite) -> dict[str, Campaign]:
        """The campaigns of members that have one, by the members' names."""
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
    """Return a look that is also reported, if there is a reporter."""

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
    """Whether none is at work, or about to be."""
    return all(campaign is None or campaign.state in AT_REST for campaign in campaigns)
