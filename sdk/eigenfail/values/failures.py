"""The list of failures of all campaigns: its filters and its order."""

import msgspec

from eigenfail.errors import UnknownName
from eigenfail.values.campaign import CampaignFilter

FAILURE_ORDERS = ("-severity", "severity")
"""Orders of the list: the most severe first, or last."""

MOST_SEVERE_FIRST = FAILURE_ORDERS[0]


class FailureFilter(msgspec.Struct, frozen=True):
    """Conditions on a failure; None for no condition.

    Attributes:
        campaign: conditions on its campaign.
        planner: planner of its campaign.
        besides: methods whose campaigns are left out.
    """

    campaign: CampaignFilter
    planner: str | None = None
    besides: tuple[str, ...] = ()


class FailureRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Parameters of the list of failures of all campaigns; None for no condition.

    Attributes:
        project: project of the campaigns.
        planner: planner of the campaigns.
        planner_version: version of the planner, as the campaigns state it.
        method: method of the campaigns.
        archived: whether failures of archived campaigns are listed, too.
        sort: one of `FAILURE_ORDERS`.
    """

    project: str | None = None
    planner: str | None = None
    planner_version: str | None = None
    method: str | None = None
    archived: bool = False
    sort: str = MOST_SEVERE_FIRST


def parse_failure_sort(text: str) -> bool:
    """Return whether the order has the most severe failures first.

    Raises:
        UnknownName: the text is not one of `FAILURE_ORDERS`.
    """
    tidy = text.strip()
    if tidy not in FAILURE_ORDERS:
        raise UnknownName("sort", tidy, FAILURE_ORDERS)
    return tidy == MOST_SEVERE_FIRST
