"""Which campaigns replay what another one found, and where they are listed."""

from urllib.parse import urlencode

from eigenfail.values import CampaignSpec
from eigenfail_api.dashboard.views.campaign_costs import REPLAY

PARENTS = {"analysis": "/analyses/{}", "campaign": "/campaigns/{}"}
"""Settings of a replay, with the pages of what they name."""


def origin(spec: CampaignSpec) -> tuple[str, str] | None:
    """What a replay repeats, in words, and its page; None of what is no replay."""
    if spec.method != REPLAY:
        return None
    named = ((kind, spec.settings.get(kind)) for kind in PARENTS)
    return next((parent(kind, found) for kind, found in named if found is not None), None)


def parent(kind: str, number: int) -> tuple[str, str]:
    """One that a replay names."""
    return f"{kind} {number}", PARENTS[kind].format(number)


def replays_of(campaign: int) -> str:
    """The list of the replays of single episodes of a campaign, which are called after these."""
    return f"/?{urlencode({'method': REPLAY, 'search': f'replay of {campaign}/'})}"
