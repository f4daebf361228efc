"""The safety measures of a campaign, from what the store holds of it."""

from eigenfail.contracts import Store
from eigenfail.values import Campaign, Safety
from eigenfail.values.safety import LEVEL
from eigenfail_services.analysis.safety import safety
from eigenfail_services.campaigns.remembered import Remembered
from eigenfail_services.campaigns.summary import conflicts, unresolved

MOST_TABLES = 500

# The intervals of VaR and CVaR take longer than everything else on a page that shows them.
KNOWN: Remembered[Safety] = Remembered(MOST_TABLES)


def safety_of(store: Store, campaign: Campaign, level: float = LEVEL) -> Safety:
    """The safety table of the episodes so far.

    Raises:
        InvalidValue: the level is not between 0 and 1.
    """
    totals, measured = store.episodes.totals(campaign.id), store.episodes.safety(campaign.id)
    return KNOWN.get(
        store,
        (campaign.id, level),
        (campaign.counts, totals, measured.completed),
        lambda: safety(
            campaign,
            measured,
            conflicts(totals.conflicts),
            unresolved(campaign, totals.conflicts),
            level,
        ),
    )
