"""Safety measures and cost of a campaign: what takes longer to make than its page."""

import msgspec

from eigenfail.functions import drives
from eigenfail.values import FINAL_STATES, Campaign, CampaignCost, Safety
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.charts import Chart
from eigenfail_api.dashboard.views.findings import Grid
from eigenfail_api.dashboard.views.safety import SafetyView, safety_view, scatter_chart
from eigenfail_api.dashboard.views.spending import SpendingView, spending_view
from eigenfail_services.campaigns.worlds import varied


class MeasuresView(msgspec.Struct, frozen=True, kw_only=True):
    """A part of the campaign's page, and a page by itself.

    Attributes:
        basis: of how many episodes it tells, or why there is nothing to tell.
        safety: None before the first episode, and where nothing drives.
        scatter: None without a failure of known severity.
        cost: None before the first episode.
        varies: whether scenario parameters are drawn, so that there may be a failing region.
        crew: without rows before the first result.
    """

    campaign: int
    campaign_name: str
    basis: str
    safety: SafetyView | None
    scatter: Chart | None
    cost: SpendingView | None
    varies: bool
    crew: Grid


def measures_view(
    campaign: Campaign, safety: Safety, cost: CampaignCost, crew: Grid
) -> MeasuresView:
    """All of it, as far as there is something to tell."""
    some = safety.completed > 0
    return MeasuresView(
        campaign=campaign.id,
        campaign_name=campaign.spec.name,
        basis=basis(campaign, safety.completed, cost.completed),
        safety=safety_view(safety) if some and drives(campaign.spec) else None,
        scatter=scatter_chart(safety.scatter) if safety.scatter.points else None,
        cost=spending_view(cost) if some else None,
        varies=some and bool(varied(campaign.spec)),
        crew=crew,
    )


def basis(campaign: Campaign, completed: int, billed: int) -> str:
    """Of how many episodes these figures are: others on the page may be further on."""
    is_open = campaign.state not in FINAL_STATES
    if not completed and is_open:
        return "Safety measures and cost are told once an episode has ended."
    if not completed:
        return "No episode was completed: there are no safety measures, and no failure has a price."
    if is_open:
        so_many = formats.counted(completed, "completed episode")
        further = f"; cost as of {formats.integer(billed)}" if billed != completed else ""
        return f"As of {so_many}{further}: worked out less often than the figures above."
    return f"Over all episodes that were completed: {formats.integer(completed)}."
