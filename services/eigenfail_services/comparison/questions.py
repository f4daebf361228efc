"""What campaigns ask: their settings side by side, and which campaigns ask the same."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import msgspec
from msgspec.structs import replace

from eigenfail.suites import KeyPath, list_leaves
from eigenfail.values import Campaign, CampaignSpec, Distinction, Priority
from eigenfail_services.campaigns.resolution import fill_defaults

Group = tuple[Campaign, ...]

THINGS = {
    "method": "method",
    "settings": "method",
    "parallel": "method",
    "scenario": "scenario",
    "scenario_parameters": "scenario",
    "planner": "planner",
    "planner_settings": "planner",
    "planner_version": "planner",
    "simulator": "simulator",
    "disturbance": "disturbance model",
    "requirements": "requirements",
    "importance": "method",
    "episodes": "budget",
    "stop": "stop rules",
    "price_usd_per_hour": "price",
    "instances": "price",
}
"""Which thing a field of a spec belongs to; the others change no result."""

RANKS = {field: rank for rank, field in enumerate(THINGS)}
FIELD_RANKS = {field: rank for rank, field in enumerate(CampaignSpec.__struct_fields__)}

OWNERS = {
    "settings": "method",
    "planner_settings": "planner",
    "scenario_parameters": "scenario",
}
"""The field of a spec that names the plug-in to which the settings of another field belong."""

DRAWN = "scenario_parameters"
"""A parameter may have a distribution in place of a value: that is one setting."""

DEFAULT = "default"

NO_VERSION = "not given"
"""The value of `planner_version` in a spec without one: there is no default version."""

NOTHING = "–"
"""The value of a setting that a plug-in does not have, or that is None."""

FlatSpec = Mapping[str, str]
"""The values of a spec as text, by dotted path."""


def group_alike(campaigns: Sequence[Campaign]) -> tuple[Group, ...]:
    """Group campaigns that differ only in name, priority and seed, in the order of their first."""
    found: dict[bytes, list[Campaign]] = {}
    for campaign in campaigns:
        alike = replace(campaign.spec, name="alike", seed=0, priority=Priority.NORMAL)
        key = msgspec.msgpack.encode(fill_defaults(alike), order="sorted")
        found.setdefault(key, []).append(campaign)
    return tuple(map(tuple, found.values()))


def write_release_question(spec: CampaignSpec) -> str:
    """Return text that is equal for campaigns of which each can be a release of the same planner.

    Settings of method and planner may differ: a release changes its planner, and the noise that the
    method draws is compared elsewhere.
    """
    fields = ("method", "planner", "scenario", "scenario_parameters", "simulator", "disturbance")
    asked = CampaignSpec(
        **{name: getattr(spec, name) for name in fields},
        name="-",
        episodes=1,
        requirements=spec.all_requirements,
    )
    same = replace(fill_defaults(asked), settings={}, planner_settings={})
    return msgspec.json.encode(same, order="deterministic").decode()


def list_given_settings(spec: CampaignSpec) -> dict[KeyPath, Any]:
    """Return all settings of a campaign but name and priority, by path."""
    table = msgspec.to_builtins(spec)
    del table["name"], table["priority"]
    drawn = table.pop(DRAWN)
    found: dict[KeyPath, Any] = {path: value for path, value in list_leaves(table) if value != {}}
    return found | {(DRAWN, name): value for name, value in drawn.items()}


def list_differing(specs: Sequence[CampaignSpec]) -> list[KeyPath]:
    """Return the paths at which specs differ, in the order of a spec's fields; names aside."""
    first, *others = given = [list_given_settings(spec) for spec in specs]
    absent = object()
    differing = [
        path
        for path in dict.fromkeys(path for one in given for path in one)
        if any(one.get(path, absent) != first.get(path, absent) for one in others)
    ]
    return sorted(differing, key=lambda path: FIELD_RANKS[path[0]])


def flatten_spec(spec: CampaignSpec) -> dict[str, str]:
    """Return every value of a spec, defaults included, as text by dotted path."""
    plain = msgspec.to_builtins(fill_defaults(spec))
    named = [f"{each.in_words()} (scale {each.scale:g})" for each in spec.all_requirements]
    values = list_leaves(plain | {"requirements": "; ".join(named)})
    return {
        ".".join(path): NOTHING if value is None else str(value)
        for path, value in values
        if value != {}
    }


class SettingValues(msgspec.Struct, frozen=True):
    """The values of one setting in several campaigns, as text.

    Attributes:
        path: path in a CampaignSpec.
        values: values in the order of the campaigns.
    """

    path: str
    values: tuple[str, ...]

    @property
    def differs(self) -> bool:
        """Whether the campaigns have different values."""
        return len(set(self.values)) > 1


def compare_settings(campaigns: Sequence[Campaign]) -> tuple[SettingValues, ...]:
    """Return all settings of campaigns, with the defaults of installed plug-ins."""
    flat = [flatten_spec(each.spec) for each in campaigns]
    paths = dict.fromkeys(path for each in flat for path in each)
    return tuple(
        SettingValues(path, tuple(each.get(path, NOTHING) for each in flat))
        for path in sorted(paths, key=lambda path: FIELD_RANKS[_name_field(path)])
    )


def find_distinctions(
    a: Sequence[CampaignSpec], b: Sequence[CampaignSpec]
) -> tuple[Distinction, ...]:
    """Return every setting whose values differ between the sides, in the order of `THINGS`.

    Defaults are resolved on both sides, so that writing one out makes no difference. A setting that
    only one side's plug-ins have is listed if a campaign gives it another value than the default.
    The version of the planner is one of them: a campaign without one differs from one with it.
    """
    left, right = [*map(flatten_spec, a)], [*map(flatten_spec, b)]
    shared = _list_paths(left) & _list_paths(right)
    of_one_side = (_list_paths(left) ^ _list_paths(right)) & _find_chosen_paths([*a, *b])
    found = []
    for path in _sort_paths(shared | of_one_side):
        one, other = (_find_values(side, path, [*left, *right]) for side in (left, right))
        if one != other:
            found.append(Distinction(path, ", ".join(one), ", ".join(other)))
    return tuple(found)


def find_differing_fields(found: Iterable[Distinction]) -> tuple[str, ...]:
    """Return the things that the distinctions belong to, each once."""
    return tuple(dict.fromkeys(THINGS[_name_field(each.thing)] for each in found))


def find_mixed_fields(specs: Sequence[CampaignSpec]) -> tuple[str, ...]:
    """Return the things in which the campaigns of one side differ among themselves."""
    side = [*map(flatten_spec, specs)]
    mixed = (
        THINGS[_name_field(path)]
        for path in _sort_paths(_list_paths(side))
        if len(_find_values(side, path, side)) > 1
    )
    return tuple(dict.fromkeys(mixed))


def _name_field(path: str) -> str:
    return path.partition(".")[0]


def _list_paths(side: Iterable[FlatSpec]) -> set[str]:
    """Return the paths of the settings on which results depend."""
    return {path for spec in side for path in spec if _name_field(path) in THINGS}


def _sort_paths(paths: Iterable[str]) -> list[str]:
    return sorted(paths, key=lambda path: (RANKS[_name_field(path)], path))


def _find_values(
    side: Iterable[FlatSpec], path: str, all_specs: Iterable[FlatSpec]
) -> tuple[str, ...]:
    """Return the different values of a setting over the campaigns of a side."""
    found = {spec.get(path) or _name_absent(path, spec, all_specs) for spec in side}
    return tuple(sorted(found))


def _name_absent(path: str, spec: FlatSpec, all_specs: Iterable[FlatSpec]) -> str:
    """Return the value of a setting that a spec does not have.

    It is the default only if the plug-in has such a setting, as another campaign of it shows.
    """
    if path == "planner_version":
        return NO_VERSION
    owner = OWNERS.get(_name_field(path))
    alike = (other for other in all_specs if owner is None or other[owner] == spec[owner])
    return DEFAULT if any(path in other for other in alike) else NOTHING


def _find_chosen_paths(specs: Sequence[CampaignSpec]) -> set[str]:
    """Return the settings of plug-ins to which a campaign gives another value than the default."""
    found = set()
    for spec in specs:
        bare = replace(
            spec,
            settings={},
            planner_settings={},
            scenario_parameters={},
            requirements=msgspec.UNSET,
            importance=msgspec.UNSET,
            planner_version=msgspec.UNSET,
        )
        given, default = flatten_spec(spec), flatten_spec(bare)
        found |= {path for path, value in given.items() if default.get(path) != value}
    return found
