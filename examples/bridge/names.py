"""What a reset names, held against what the bridge has said that it knows."""

from collections.abc import Iterable, Mapping
from typing import Any

from eigenfail.errors import InvalidValue, UnknownName


def check(welcome: Mapping[str, Any], asked: Mapping[str, Any]) -> dict[str, Any]:
    """All parameters and settings by name: the defaults, or what the reset sets in their place.

    Raises:
        UnknownName: the scenario, the planner, or one of those.
        InvalidValue: a text where a number is due, or the other way round.
    """
    scenario = of_name("scenario", asked["scenario"], welcome["scenarios"])
    planner = of_name("planner", asked["planner"], welcome["planners"])
    known = scenario["parameters"] | planner["settings"]
    given = asked["parameters"] | asked["settings"]
    for name in given:
        if name not in known:
            raise UnknownName("parameter", name, known)
        if isinstance(known[name], str) is not isinstance(given[name], str):
            raise InvalidValue(name, f"{given[name]!r} is not what its default {known[name]!r} is.")
    return dict(known | given)


def of_name(kind: str, name: str, all_of_them: Iterable[Mapping[str, Any]]) -> Mapping[str, Any]:
    """The scenario or planner of that name; raises UnknownName."""
    by_name = {each["name"]: each for each in all_of_them}
    if name not in by_name:
        raise UnknownName(kind, name, by_name)
    return by_name[name]


def check_channels(welcome: Mapping[str, Any], asked: Mapping[str, Any]) -> tuple[str, ...]:
    """Names of the channels of a reset.

    Raises:
        UnknownName: a channel that the bridge does not offer.
    """
    named = tuple(each["name"] for each in asked["channels"])
    for name in named:
        if name not in welcome["channels"]:
            raise UnknownName("channels", name, welcome["channels"])
    return named
