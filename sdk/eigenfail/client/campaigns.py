"""Campaigns, as a client sees them: followed and steered here, made and judged by the parts."""

from collections.abc import Callable

from eigenfail.client.campaign_findings import CampaignFindings
from eigenfail.client.campaign_making import SHRINK_WITHIN, CampaignMaking
from eigenfail.client.link import Link
from eigenfail.client.waiting import telling, wait_until
from eigenfail.rows import Rows
from eigenfail.values import FINAL_STATES, Campaign, CampaignState, Page, Priority
from eigenfail.values.priority import PriorityChange
from eigenfail.wire.http import read_fields

__all__ = ["AT_REST", "SHRINK_WITHIN", "Campaigns"]

AT_REST = FINAL_STATES | {CampaignState.PAUSED}


class Campaigns(CampaignMaking, CampaignFindings):
    """Create, follow and steer campaigns.

    Every method raises ServiceUnreachable if no service answers.
    """

    def __init__(self, link: Link) -> None:
        self._link = link

    def get(self, campaign: int) -> Campaign:
        """The campaign as it stands.

        Raises:
            NotFound: no such campaign.
        """
        return self._link.get(f"/campaigns/{campaign}", Campaign)

    def list(
        self,
        state: CampaignState | str | None = None,
        suite: str | None = None,
        method: str | None = None,
        search: str | None = None,
    ) -> Rows[Campaign]:
        """All campaigns, or those of which all that is given holds; newest first.

        Args:
            state: in which they are.
            suite: to which they belong.
            method: by its name.
            search: text that their names hold, in small or large letters.
        """
        asked = {"state": state, "suite": suite, "method": method, "search": search}
        return self._link.pages("/campaigns", Page[Campaign], "before", asked)

    def pause(self, campaign: int) -> Campaign:
        """Let it rest once the rounds at work are in.

        Raises:
            NotFound: no such campaign.
            IllegalTransition: it has ended.
        """
        return self._link.post(f"/campaigns/{campaign}/pause", Campaign)

    def resume(self, campaign: int) -> Campaign:
        """Let it go on.

        Raises:
            NotFound: no such campaign.
            IllegalTransition: it is not paused.
        """
        return self._link.post(f"/campaigns/{campaign}/resume", Campaign)

    def cancel(self, campaign: int) -> Campaign:
        """End it; finished episodes are kept.

        Raises:
            NotFound: no such campaign.
            IllegalTransition: it has ended otherwise.
        """
        return self._link.post(f"/campaigns/{campaign}/cancel", Campaign)

    def prioritise(self, campaign: int, priority: Priority | str) -> Campaign:
        """Give it another priority, low, normal or high, from now on; its episodes stay the same.

        Raises:
            NotFound: no such campaign.
            IllegalTransition: it has ended.
            InvalidValue: there is no such priority.
        """
        change = read_fields({"priority": priority}, PriorityChange)
        return self._link.post(f"/campaigns/{campaign}/priority", Campaign, change)

    def wait(
        self,
        campaign: int,
        on_progress: Callable[[Campaign], None] | None = None,
        poll_s: float = 0.3,
        timeout_s: float | None = None,
        progress: bool = False,
    ) -> Campaign:
        """The campaign once it has ended or is paused.

        Args:
            campaign: its id.
            on_progress: told of the campaign at every look, the last one included.
            poll_s: time between two looks.
            timeout_s: give up after this time; None waits for ever.
            progress: show failures, rate and the time to go: a bar in a terminal or a notebook,
                plain lines on standard error elsewhere.

        Raises:
            NotFound: no such campaign.
            ServiceError: it did not end in time; it goes on all the same.
        """
        with telling(on_progress, progress) as tell:

            def look() -> Campaign:
                seen = self.get(campaign)
                tell(seen)
                return seen

            return wait_until(look, lambda seen: seen.state in AT_REST, poll_s, timeout_s)
