"""What a campaign's end means for the exit code."""

import typer

from eigenfail.errors import ServiceError
from eigenfail.values import FINAL_STATES, Campaign, CampaignState

FAILURES_FOUND = 1


def judge(campaign: Campaign, gate: bool) -> None:
    """Exit with 1 if a gate was asked for and failures were found.

    Raises:
        ServiceError: the campaign came to nothing, so that no gate may pass on it.
    """
    counts = campaign.counts
    if campaign.state is CampaignState.DEAD:
        raise ServiceError(f"Campaign {campaign.id} is dead: {campaign.stopped_because}")
    if gate and counts.failures:
        raise typer.Exit(FAILURES_FOUND)
    if gate and campaign.state is not CampaignState.DONE:
        raise ServiceError(
            f"Campaign {campaign.id} is {campaign.state}, so its gate proves nothing.",
            "Start one like it anew."
            if campaign.state in FINAL_STATES
            else f"Let it end: eigenfail campaign resume {campaign.id}",
        )
    if gate and not counts.completed:
        raise ServiceError(
            f"Campaign {campaign.id} completed no episode, so its gate proves nothing.",
            f"See why: eigenfail episode list {campaign.id} --outcome failed",
        )
