"""Where a campaign's settings name earlier campaigns, and whether these can be built upon."""

from collections.abc import Mapping
from typing import Any

import msgspec

from eigenfail import plugins
from eigenfail.contracts import Store
from eigenfail.errors import InvalidValue, NotFound
from eigenfail.settings import read_settings
from eigenfail.values import FINAL_STATES, Campaign, CampaignSpec

ENSEMBLE = "ensemble"


class Search(msgspec.Struct, frozen=True):
    """The method that searches, and its settings; `field` is where these stand in the spec."""

    method: str
    settings: Mapping[str, Any]
    field: str = "settings"


def search(spec: CampaignSpec) -> Search:
    """The campaign's own method, or that of its ensemble's members."""
    found = Search(spec.method, spec.settings)
    if found.method != ENSEMBLE:
        return found
    kind = plugins.load(plugins.METHODS, ENSEMBLE).Settings
    members = read_settings(kind, found.settings, found.field)
    return Search(members.method, members.settings, f"{found.field}.settings")


def ended(campaign: int, field: str, store: Store) -> Campaign:
    """An earlier campaign; one that goes on would make a later one depend on the clock.

    Raises:
        InvalidValue: no such campaign, or it has not ended.
    """
    try:
        before = store.campaigns.get(campaign)
    except NotFound as error:
        raise InvalidValue(field, error.problem, error.remedy) from error
    if before.state not in FINAL_STATES:
        problem = f"campaign {campaign} is {before.state} and has not ended."
        remedy = f"Wait for its end (`eigenfail campaign watch {campaign}`), or cancel it."
        raise InvalidValue(field, problem, remedy)
    return before
