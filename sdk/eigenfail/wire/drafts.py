"""What client and API say to each other of campaigns before they are launched."""

import msgspec

from eigenfail.values.campaign import CampaignSpec
from eigenfail.wire.problems import Problem

MOST_AT_ONCE = 500
"""Campaigns that one request creates at most."""


class CampaignCheck(msgspec.Struct, frozen=True):
    """What would come of a campaign that is not launched yet.

    Attributes:
        spec: all of it, with every default that plug-ins fill in; None where there is a problem.
        problems: everything that is wrong with it, each as a launch would be refused for it.
        notes: what should be known before it is launched: how late a stop rule may come.
    """

    spec: CampaignSpec | None
    problems: tuple[Problem, ...] = ()
    notes: tuple[str, ...] = ()
