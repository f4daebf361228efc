"""Where a failure is replayed unless its user says otherwise: its own scenario, and neighbours."""

from collections.abc import Iterator, Mapping
from typing import Any, get_args, get_type_hints

import msgspec

from eigenfail import bridges, functions, plugins
from eigenfail.values import CampaignSpec
from eigenfail.values.variation import read_variation

NEARBY = "nearby"
"""In the `extra` of a parameter's `Meta`: how far its neighbours are, in its own unit."""

SHARE = 0.25
"""Of the range of the first bounded parameter, where a scenario names no neighbours."""


class Bounded(msgspec.Struct, frozen=True):
    """A parameter that has two bounds, and how far its neighbours are."""

    name: str
    low: float
    high: float
    distance: float
    is_named: bool


def nearby(spec: CampaignSpec) -> tuple[dict[str, Any], ...]:
    """Scenario parameters to put over a campaign's own: none, then one below and one above.

    Neighbours are those that the scenario names; otherwise its first bounded parameter is moved by
    a quarter of its range. They stay within the bounds, and a parameter that varies anyway is left
    alone.
    """
    if spec.simulator in (functions.SIMULATOR, bridges.SIMULATOR):
        return ({},)
    kind = plugins.load(plugins.SCENARIOS, spec.scenario).Parameters
    variation = read_variation(kind, spec.scenario_parameters)
    parameters = next(iter(variation.corners()))
    fixed = [each for each in moved(kind) if each.name not in variation.varied]
    sides = (around(each, getattr(parameters, each.name)) for each in fixed)
    return ({}, *(beside for side in sides for beside in side))


def moved(kind: type[msgspec.Struct]) -> list[Bounded]:
    """The parameters that have neighbours."""
    known = list(bounded(kind))
    return [each for each in known if each.is_named] or known[:1]


def bounded(kind: type[msgspec.Struct]) -> Iterator[Bounded]:
    """The parameters with two bounds, in the order in which the scenario lists them."""
    for name, hint in get_type_hints(kind, include_extras=True).items():
        for meta in get_args(hint)[1:]:
            if isinstance(meta, msgspec.Meta) and meta.ge is not None and meta.le is not None:
                yield told(name, meta.ge, meta.le, meta.extra or {})


def told(name: str, low: float, high: float, extra: Mapping[str, Any]) -> Bounded:
    """A parameter as its annotation tells of it."""
    return Bounded(name, low, high, extra.get(NEARBY, SHARE * (high - low)), NEARBY in extra)


def around(parameter: Bounded, value: float) -> Iterator[dict[str, Any]]:
    """Its neighbours to both sides of a value, as far as the bounds let them differ from it."""
    for place in (value - parameter.distance, value + parameter.distance):
        within = min(max(place, parameter.low), parameter.high)
        neighbour = type(value)(within)
        if neighbour != value:
            yield {parameter.name: neighbour}
