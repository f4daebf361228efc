"""The safety measures of a campaign, from what the store holds of it."""

from eigenfail.contracts import Store
from eigenfail.values import Campaign, Safety
from eigenfail.values.safety import LEVEL
from eigenfail_services.analysis.safety import safety
from eigenfail_services.campaigns.summary import conflicts


def safety_of(store: Store, campaign: Campaign, level: float = LEVEL) -> Safety:
    """The safety table of the episodes so far.

    Raises:
        InvalidValue: the level is not between 0 and 1.
    """
    totals = store.episodes.totals(campaign.id)
    return safety(campaign, store.episodes.safety(campaign.id), conflicts(totals.conflicts), level)
