"""The failing region of campaigns, as a service finds it."""

from eigenfail.client import Client
from eigenfail.client.references import CampaignsLike, find_campaign_ids
from eigenfail_failing_region.values import Region


def ask_region(client: Client, campaigns: CampaignsLike) -> Region:
    """Return where among the scenario's parameters the episodes of campaigns so far fail.

    Args:
        client: client of the service that has the campaigns; the plug-in is installed there, too.
        campaigns: one whose parameters vary, or several on one scenario, such as a grid's.

    Raises:
        NotFound: no such campaign, or a service without the plug-in.
        InvalidValue: none is named, one twice, or they are on different scenarios.
        UnknownName: the service does not have their scenario.
    """
    ids = ",".join(map(str, find_campaign_ids(campaigns)))
    return client.link.get("/region", Region, {"campaigns": ids})
