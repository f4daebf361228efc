"""Campaigns as a store returns them, without a store."""

from typing import Any

from eigenfail.values.campaign import Campaign, CampaignState, Counts
from eigenfail.values.campaign_spec import CampaignSpec


def make_campaign(
    counts: Counts,
    method: str = "monte_carlo",
    state: CampaignState = CampaignState.DONE,
    spec: dict[str, Any] | None = None,
    **fields: Any,
) -> Campaign:
    """Campaign 7, `truck`, of as many episodes as are planned.

    Args:
        counts: its episodes.
        method: its method.
        state: its state.
        spec: further fields of its specification.
        fields: further fields of the campaign.
    """
    asked = CampaignSpec(name="truck", method=method, episodes=counts.planned, **spec or {})
    return Campaign(id=7, spec=asked, state=state, counts=counts, created_ms=1, **fields)
