"""A small player of an episode, for a card of another page."""

import msgspec

from eigenfail.values import Campaign, EpisodeResult, Mission
from eigenfail_api.dashboard.views.charts import Chart
from eigenfail_api.dashboard.views.scene import scene_chart
from eigenfail_api.dashboard.views.states import OUTCOME_BADGES, Badge


class ClipView(msgspec.Struct, frozen=True, kw_only=True):
    """An episode that can be played; `scene` is None where none was kept."""

    campaign: int
    campaign_name: str
    index: int
    badge: Badge
    scene: Chart | None


def clip_view(campaign: Campaign, result: EpisodeResult, mission: Mission | None) -> ClipView:
    """The player of an episode."""
    name = f"clip-{campaign.id}-{result.index}-scene"
    return ClipView(
        campaign=campaign.id,
        campaign_name=campaign.spec.name,
        index=result.index,
        badge=OUTCOME_BADGES[result.outcome],
        scene=scene_chart(result.scene, mission, result.outcome, name) if result.scene else None,
    )
