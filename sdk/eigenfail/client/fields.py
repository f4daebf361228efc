"""Fields of campaigns and analyses as keyword arguments, with the types that may be given.

Fields of values may be values or plain data, as in TOML and JSON.
"""

from collections.abc import Mapping, Sequence
from typing import Any, TypedDict

from eigenfail.errors import InvalidValue
from eigenfail.values.campaign_spec import Priority, StopRules
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.requirements import AnyRequirement

Plain = Mapping[str, Any]
"""A value as plain data: its fields by their names."""


# Written out, and not made from CampaignSpec, since type checkers read no code that runs. A test
# compares both.
class _DefaultedFields(TypedDict, total=False):
    seed: int
    settings: Plain
    scenario: str
    scenario_parameters: Plain
    planner: str
    planner_settings: Plain
    simulator: str
    disturbance: DisturbanceModel | Plain
    stop: StopRules | Plain
    parallel: int | None
    price_usd_per_hour: float
    instances: int
    scene_every: int
    priority: Priority | str
    planner_version: str
    project: str
    tags: Sequence[str]
    requirements: Sequence[AnyRequirement | Plain]
    importance: AnyRequirement | Plain


class CampaignFields(_DefaultedFields):
    """Fields of a new campaign; `eigenfail.values.CampaignSpec` documents each.

    Attributes:
        name: name of the campaign.
        method: name of the search method.
        episodes: the budget.
    """

    name: str
    method: str
    episodes: int


class CampaignChanges(_DefaultedFields, total=False):
    """Fields of a campaign, all optional."""

    name: str
    method: str
    episodes: int


class AnalysisFields(TypedDict, total=False):
    """Fields of `eigenfail.values.AnalysisSettings`, all optional."""

    align: str
    components: int
    clusters: int | None
    axes: str
    clusterer: str
    campaigns: Sequence[int]
    bootstrap: int
    failures: str
    centre: str
    features: str


def refuse_fields_beside(parameter: str, whole: object, fields: Mapping[str, object]) -> None:
    """Refuse single fields that are given together with the whole value.

    Raises:
        InvalidValue: both are given.
    """
    if whole is not None and fields:
        kind, names = type(whole).__name__, ", ".join(fields)
        raise InvalidValue(
            parameter,
            f"a whole {kind} is given together with fields of it: {names}.",
            f"Give either of them; msgspec.structs.replace({parameter}, …) changes fields.",
        )
