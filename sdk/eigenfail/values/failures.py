"""Failures of all campaigns in one list: which of them, and in which order."""

import msgspec

from eigenfail.errors import UnknownName
from eigenfail.values.campaign import CampaignFilter

FAILURE_ORDERS = ("-severity", "severity")
"""Orders of the list: the most severe first, or last."""

MOST_SEVERE_FIRST = FAILURE_ORDERS[0]


class FailureFilter(msgspec.Struct, frozen=True):
    """The conditions on a failure; None if anything will do.

    Attributes:
        campaign: what its campaign must be.
        planner: planner of its campaign.
        besides: methods whose campaigns are left out.
    """

    campaign: CampaignFilter
    planner: str | None = None
    besides: tuple[str, ...] = ()


class FailureRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Parameters of the list of the failures of all campaigns; None if anything will do.

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
    """Return whether an order of failures has the most severe first.

    Raises:
        UnknownName: failures of all campaigns cannot be sorted by it.
    """
    tidy = text.strip()
    if tidy not in FAILURE_ORDERS:
        raise UnknownName("sort", tidy, FAILURE_ORDERS)
    return tidy == MOST_SEVERE_FIRST
