"""In what two groups of campaigns were not asked for the same."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import msgspec

from eigenfail.values import CampaignSpec, Distinction

THINGS = {
    "method": "method",
    "settings": "method",
    "scenario": "scenario",
    "scenario_parameters": "scenario",
    "planner": "planner",
    "planner_settings": "planner",
    "simulator": "simulator",
    "disturbance": "disturbance model",
    "episodes": "budget",
    "stop": "stop rules",
    "price_usd_per_hour": "price",
    "instances": "price",
}
"""Which thing a field of a spec belongs to; the others change no result."""

DEFAULT = "default"


def distinctions(a: Sequence[CampaignSpec], b: Sequence[CampaignSpec]) -> tuple[Distinction, ...]:
    """Every setting that has other values on one side than on the other."""
    left, right = values_by_path(a), values_by_path(b)
    paths = sorted(left.keys() | right.keys(), key=place)
    nothing = (DEFAULT,)
    return tuple(
        Distinction(path, listed(left.get(path, nothing)), listed(right.get(path, nothing)))
        for path in paths
        if left.get(path, nothing) != right.get(path, nothing)
    )


def things(found: Iterable[Distinction]) -> tuple[str, ...]:
    """The things that the distinctions belong to, each once."""
    return tuple(dict.fromkeys(THINGS[each.thing.partition(".")[0]] for each in found))


def mixed(specs: Sequence[CampaignSpec]) -> tuple[str, ...]:
    """The things in which the campaigns of one side differ among themselves."""
    paths = values_by_path(specs)
    return things(
        Distinction(path, "", "") for path in sorted(paths, key=place) if len(paths[path]) > 1
    )


def values_by_path(specs: Sequence[CampaignSpec]) -> dict[str, tuple[str, ...]]:
    """The different values of each setting over some campaigns, as text; a dot goes deeper."""
    plain = [dict(leaves(msgspec.to_builtins(spec))) for spec in specs]
    paths = dict.fromkeys(path for each in plain for path in each)
    return {
        path: tuple(sorted({each.get(path, DEFAULT) for each in plain}))
        for path in paths
        if path.partition(".")[0] in THINGS
    }


def leaves(value: dict[str, Any], above: str = "") -> Iterator[tuple[str, str]]:
    """Every plain value inside nested dicts, as text."""
    for name, part in value.items():
        if isinstance(part, dict):
            yield from leaves(part, f"{above}{name}.")
        else:
            yield f"{above}{name}", str(part)


def place(path: str) -> tuple[int, str]:
    """Where a setting stands in a list: in the order of the things."""
    return list(THINGS).index(path.partition(".")[0]), path


def listed(values: tuple[str, ...]) -> str:
    """One value, or several."""
    return ", ".join(values)
