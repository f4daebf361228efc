"""Safety measures and cost of a campaign: what takes longer to make than its page."""

import msgspec

from eigenfail.functions import drives
from eigenfail.values import Campaign, CampaignCost, Safety
from eigenfail_api.dashboard.views.charts import Chart
from eigenfail_api.dashboard.views.safety import SafetyView, safety_view, scatter_chart
from eigenfail_api.dashboard.views.spending import SpendingView, spending_view


class MeasuresView(msgspec.Struct, frozen=True, kw_only=True):
    """A part of the campaign's page, and a page by itself.

    Attributes:
        safety: None before the first episode, and where nothing drives.
        scatter: None without a failure of known severity.
        cost: None before the first episode.
    """

    campaign: int
    campaign_name: str
    safety: SafetyView | None
    scatter: Chart | None
    cost: SpendingView | None


def measures_view(campaign: Campaign, safety: Safety, cost: CampaignCost) -> MeasuresView:
    """All of it, as far as there is something to tell."""
    some = safety.completed > 0
    return MeasuresView(
        campaign=campaign.id,
        campaign_name=campaign.spec.name,
        safety=safety_view(safety) if some and drives(campaign.spec) else None,
        scatter=scatter_chart(safety.scatter) if safety.scatter.points else None,
        cost=spending_view(cost) if some else None,
    )
