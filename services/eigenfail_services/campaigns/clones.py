"""Campaigns like earlier ones: with other values, or going on from what was learnt."""

from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

from eigenfail import plugins
from eigenfail.contracts import Store
from eigenfail.errors import EigenfailError
from eigenfail.values import FINAL_STATES, Campaign, CampaignSpec
from eigenfail_services.campaigns.drafts import COMPANIONS, read_draft
from eigenfail_services.campaigns.experience import SETTING as DATA
from eigenfail_services.campaigns.pairing import DRAWS_FROM_PRIOR
from eigenfail_services.campaigns.predecessors import LEARNERS, check_useful

EVALUATE = "evaluate"
WARM_START = LEARNERS["ast"]

TABLES = ("settings", "scenario_parameters", "planner_settings", "disturbance", "stop")
"""Fields whose values are put over the earlier ones, name by name."""


class Continuation(msgspec.Struct, frozen=True):
    """A way to build on an earlier campaign.

    Attributes:
        words: what it does.
        changes: of the campaign's fields, by path.
    """

    words: str
    changes: Mapping[str, Any]


def clone(spec: CampaignSpec, changes: Mapping[str, Any], store: Store) -> CampaignSpec:
    """A campaign like another, with some fields changed.

    Settings and parameters are put over the earlier ones; with another plug-in the earlier ones
    mean nothing and are left out.

    Raises:
        UnknownName: a field, plug-in or setting that does not exist.
        InvalidValue: a value that cannot be.
    """
    return read_draft(changed(msgspec.to_builtins(spec), changes), store)


def changed(fields: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """The fields with the changes in them."""
    kept = dict(fields)
    for name, companion in COMPANIONS.items():
        if name in changes and changes[name] != fields.get(name):
            kept.pop(companion, None)
    for name, value in changes.items():
        over = name in TABLES and isinstance(value, dict) and isinstance(kept.get(name), dict)
        kept[name] = {**kept[name], **value} if over else value
    return kept


def continuations(campaign: Campaign) -> Iterator[Continuation]:
    """How a new campaign can build on this one; none before it has ended."""
    if campaign.state not in FINAL_STATES:
        return
    settings = settings_of(campaign.spec.method)
    if WARM_START in settings:
        words = "Start from the networks that it trained."
        yield Continuation(words, {f"settings.{WARM_START}": campaign.id})
    if DATA in settings:
        yield Continuation("Learn from its episodes first.", {f"settings.{DATA}": campaign.id})
    if has_learnt(campaign):
        words = "Use what it learnt, and learn no further."
        yield Continuation(
            words, {"method": EVALUATE, f"settings.{LEARNERS[EVALUATE]}": campaign.id}
        )


def has_learnt(campaign: Campaign) -> bool:
    """Whether its method has knowledge to be used."""
    try:
        check_useful(campaign, "")
    except EigenfailError:
        return False
    return True


def settings_of(method: str) -> tuple[str, ...]:
    """The names of a method's settings; none where it is not installed here."""
    try:
        return tuple(plugins.load(plugins.METHODS, method).Settings.__struct_fields__)
    except EigenfailError:
        return ()


def repeats(spec: CampaignSpec) -> str:
    """What more episodes of a campaign with the same seed begin with, in words."""
    if spec.method == DRAWS_FROM_PRIOR:
        return (
            f"With the same seed its first {spec.episodes:,} episodes are those of the earlier one "
            "again; give another seed for fresh ones."
        )
    return (
        f"{spec.method} plans by its budget, so that with the same seed, too, the episodes may "
        "differ from the earlier ones."
    )
