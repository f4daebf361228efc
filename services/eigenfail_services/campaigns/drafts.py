"""Campaigns before they are launched: all that is wrong with them, and all that they would be."""

import re
from collections.abc import Mapping
from typing import Any

import msgspec
from msgspec.structs import replace

from eigenfail import bridges, functions, plugins
from eigenfail.contracts import Store
from eigenfail.errors import InputError, InvalidValue, UnknownName
from eigenfail.settings import defaults_of, read_settings
from eigenfail.values import CampaignSpec
from eigenfail.values.campaign import MAX_EPISODES
from eigenfail.wire.http import MISSING, read_fields
from eigenfail_services.campaigns.checks import check_spec
from eigenfail_services.campaigns.materials import check_references

MOST_PROBLEMS = 100

STAND_INS: Mapping[str, Any] = {
    "name": "unnamed",
    "method": "monte_carlo",
    "episodes": MAX_EPISODES,
}
"""In place of what is required and wrong, while the rest is looked at; no budget is too small."""

COMPANIONS = {
    "method": "settings",
    "scenario": "scenario_parameters",
    "planner": "planner_settings",
}
"""What means nothing without the plug-in that is named beside it."""

WHOLE = (("scenario_parameters", 2), ("disturbance.shape", 2))
"""Below these, so many words down, a value is taken out whole: a part of it is none."""

BRACKETS = re.compile(r"\[[^\]]*\]")

Fields = Mapping[str, Any]


def read_draft(given: Fields, store: Store) -> CampaignSpec:
    """A campaign that can be launched, from its fields.

    Raises:
        UnknownName: a field, plug-in, setting or parameter that does not exist.
        InvalidValue: a value of the wrong type, outside its bounds, or missing; or something is
            built upon that is not there.
    """
    return check_references(check_spec(read_fields(given, CampaignSpec)), store)


def problems_of(given: Fields, store: Store) -> tuple[InputError, ...]:
    """Everything that is wrong with a campaign: what is, is taken out, and the rest looked at."""
    left, found = dict(given), list[InputError]()
    while len(found) < MOST_PROBLEMS:
        try:
            read_draft(left, store)
        except InputError as refusal:
            error = located(refusal)
            if error.field in {each.field for each in found if not isinstance(each, UnknownName)}:
                break
            found.append(error)
            reduced = without(left, error)
            if reduced == left:
                break
            left = reduced
        else:
            break
    return tuple(found)


def located(error: InputError) -> InputError:
    """The error with the path of the value, also where that is missing in a plug-in's settings."""
    if (missing := MISSING.search(error.problem)) is None:
        return error
    return InvalidValue(f"{error.field}.{missing['name']}".lstrip("."), "is required.")


def without(given: dict[str, Any], error: InputError) -> dict[str, Any]:
    """The fields without the one that an error is about."""
    path = path_of(error)
    found = [name for name in path[:1] if name in given or name in STAND_INS]
    if not found:
        return taken_out(given, (error.name,)) if isinstance(error, UnknownName) else given
    (top,) = found
    if top in STAND_INS:
        given = {**given, top: STAND_INS[top]}
    elif isinstance(error, UnknownName) and isinstance(value_at(given, path), dict):
        given = taken_out(given, (*path, error.name))
    else:
        given = taken_out(given, path)
    return given if top not in COMPANIONS else taken_out(given, (COMPANIONS[top],))


def path_of(error: InputError) -> tuple[str, ...]:
    """Where the value stands that an error is about, as names."""
    plain = BRACKETS.sub("", error.field)
    names = tuple(name for name in plain.split(".") if name)
    for above, most in WHOLE:
        if plain.startswith(above):
            return names[:most]
    return names


def value_at(given: Any, path: tuple[str, ...]) -> Any:
    """What stands at a path; None if nothing does."""
    for name in path:
        given = given.get(name) if isinstance(given, dict) else None
    return given


def taken_out(given: dict[str, Any], path: tuple[str, ...]) -> dict[str, Any]:
    """The table without what stands at a path, or at as much of it as there is."""
    name, *rest = path
    inner = given.get(name)
    if rest and isinstance(inner, dict) and rest[0] in inner:
        return {**given, name: taken_out(inner, tuple(rest))}
    return {other: value for other, value in given.items() if other != name}


def completed(spec: CampaignSpec) -> CampaignSpec:
    """A spec that was checked, with every default that its plug-ins fill in."""
    method = plugins.load(plugins.METHODS, spec.method)
    settings = plain(read_settings(method.Settings, spec.settings, "settings"))
    if spec.simulator == functions.SIMULATOR:
        parameters = plain(functions.check(spec))
        return replace(spec, settings=settings, scenario_parameters=parameters)
    if spec.simulator == bridges.SIMULATOR:
        return replace(spec, settings=settings)
    planner = plugins.load(plugins.PLANNERS, spec.planner)
    scenario = plugins.load(plugins.SCENARIOS, spec.scenario)
    return replace(
        spec,
        settings=settings,
        planner_settings=plain(read_settings(planner.Settings, spec.planner_settings, "")),
        scenario_parameters={**defaults_of(scenario.Parameters), **spec.scenario_parameters},
    )


def plain(settings: msgspec.Struct) -> dict[str, Any]:
    """A struct as plain data."""
    data: dict[str, Any] = msgspec.to_builtins(settings)
    return data
