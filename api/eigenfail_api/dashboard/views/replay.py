"""A replay of one episode, while it is waited for."""

import msgspec

from eigenfail.values import FINAL_STATES, Campaign
from eigenfail_api.dashboard.views.repeated import Verdict
from eigenfail_api.dashboard.views.states import CAMPAIGN_BADGES, Badge


class ReplayView(msgspec.Struct, frozen=True, kw_only=True):
    """Where it stands.

    Attributes:
        has_arrived: whether its episode can be looked at.
        verdict: whether it is the same again, once it is in.
        is_open: whether it may still arrive.
    """

    campaign: int
    campaign_name: str
    badge: Badge
    has_arrived: bool
    is_open: bool
    because: str
    verdict: Verdict | None


def replay_view(campaign: Campaign, verdict: Verdict | None, *, has_arrived: bool) -> ReplayView:
    """How a replay stands."""
    return ReplayView(
        campaign=campaign.id,
        campaign_name=campaign.spec.name,
        badge=CAMPAIGN_BADGES[campaign.state],
        has_arrived=has_arrived,
        is_open=not has_arrived and campaign.state not in FINAL_STATES,
        because=campaign.stopped_because,
        verdict=verdict,
    )
