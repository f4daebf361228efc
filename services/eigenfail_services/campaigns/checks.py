"""What a campaign must be before it is taken on: names known, values within bounds."""

from collections.abc import Iterator
from math import isfinite
from typing import Any
from unicodedata import category

import msgspec

from eigenfail import bridges, functions, plugins
from eigenfail.contracts import Scenario
from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.settings import convert, read_settings
from eigenfail.values import CampaignSpec
from eigenfail.values.variation import read_variation
from eigenfail_services.campaigns.earlier import search
from eigenfail_services.campaigns.fitness import check_budget, check_estimates

MAX_DEPTH = 20
LARGEST = 2**63 - 1


def check_spec(spec: CampaignSpec) -> CampaignSpec:
    """The spec itself, once everything in it is known to make sense.

    Nothing heavy is loaded for it: neither the simulator nor what methods train with.

    Raises:
        UnknownName: a plug-in, setting or parameter that does not exist; the known ones are listed.
        InvalidValue: a value of the wrong type, outside its bounds, or not a finite number; a
            budget that the method cannot begin with; or a function that may not be run here.
    """
    refuse_what_no_store_keeps(spec)
    convert(msgspec.to_builtins(spec), CampaignSpec)
    if spec.simulator not in functions.simulators():
        raise UnknownName("simulator", spec.simulator, functions.simulators())
    method = plugins.load(plugins.METHODS, spec.method)
    settings = read_settings(method.Settings, spec.settings, "settings")
    check_budget(settings, spec.episodes)
    refuse_idle_rules(spec)
    if spec.simulator == functions.SIMULATOR:
        functions.check(spec)
        functions.refuse_unlisted(spec.planner)
        return spec
    if spec.simulator == bridges.SIMULATOR:
        bridges.check(spec)
        return spec
    planner = plugins.load(plugins.PLANNERS, spec.planner)
    read_settings(planner.Settings, spec.planner_settings, "planner_settings")
    horizon(spec)
    return spec


def refuse_idle_rules(spec: CampaignSpec) -> None:
    """Raises InvalidValue for a stop rule that could never hold."""
    if spec.stop.cv is not None:
        check_estimates(search(spec), "stop.cv")


def horizon(spec: CampaignSpec) -> int:
    """The number of steps of a full episode: of the longest, where parameters vary.

    Raises:
        UnknownName: no such scenario, or it has no such parameter or distribution.
        InvalidValue: a parameter, or an end of its distribution, outside its bounds.
    """
    if spec.simulator == functions.SIMULATOR:
        return functions.check(spec).steps
    if spec.simulator == bridges.SIMULATOR:
        return bridges.horizon(spec)
    plugin = plugins.load(plugins.SCENARIOS, spec.scenario)
    scenario: Scenario = plugin()
    variation = read_variation(plugin.Parameters, spec.scenario_parameters)
    return variation.largest(lambda parameters: scenario(parameters, spec.seed).steps)


def refuse_what_no_store_keeps(spec: CampaignSpec) -> None:
    """Numbers that are not finite or too large, and text that terminals and databases choke on.

    Raises:
        InvalidValue: there is such a value; its path is named.
    """
    for path, value in leaves(spec):
        if isinstance(value, float) and not isfinite(value):
            raise InvalidValue(path, f"{value} is not a finite number.")
        if isinstance(value, int) and abs(value) > LARGEST:
            raise InvalidValue(path, f"{value} is larger than 64 bits hold.")
        if isinstance(value, str) and any(category(letter) in {"Cc", "Cs"} for letter in value):
            raise InvalidValue(path, "contains a control character.", "Take it out.")


def leaves(value: Any) -> Iterator[tuple[str, Any]]:
    """Every plain value inside a value, with its path; as deep as it goes, without recursion.

    Raises:
        InvalidValue: it goes deeper than encoders follow.
    """
    waiting: list[tuple[tuple[str, ...], Any]] = [((), value)]
    while waiting:
        path, value = waiting.pop()
        if len(path) > MAX_DEPTH:
            raise InvalidValue(path[0], f"is nested more than {MAX_DEPTH} levels deep.")
        parts = list(children(value))
        waiting.extend(((*path, name), part) for name, part in parts)
        if not parts:
            yield ".".join(path), value


def children(value: Any) -> Iterator[tuple[str, Any]]:
    """What a struct, a mapping or a sequence is made of, and the keys of mappings themselves."""
    if isinstance(value, msgspec.Struct):
        yield from msgspec.structs.asdict(value).items()
    if isinstance(value, dict):
        yield from ((str(name), part) for name, part in value.items())
        yield from (("(name)", str(name)) for name in value)
    if isinstance(value, (list, tuple)):
        yield from ((str(place), part) for place, part in enumerate(value))
