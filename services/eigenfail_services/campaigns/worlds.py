"""The scenarios in which an analysis's failures happened, so that replays can be run in them."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import msgspec

from eigenfail import bridges, functions, plugins
from eigenfail.contracts import Store
from eigenfail.errors import Conflict
from eigenfail.settings import defaults_of
from eigenfail.values import Analysis, AnalysisResult, CampaignSpec, FailureMode, episode_seed
from eigenfail.values.variation import KINDS
from eigenfail.variations import drawn_for
from eigenfail_services.campaigns.analysed import WORLD


class World(NamedTuple):
    """The analysed campaign in one scenario.

    Attributes:
        spec: of the campaign, in that scenario.
        modes: that are at home there, from 0.
        drawn: the scenario's parameters that its modes' medoids drew; none where none vary.
    """

    spec: CampaignSpec
    modes: tuple[int, ...]
    drawn: Mapping[str, Any]


def worlds(store: Store, analysis: Analysis, result: AnalysisResult) -> list[World]:
    """The scenarios of an analysis's modes: one, unless the scenario's parameters vary.

    Where they vary, a mode is at home in what its medoid drew; modes whose medoids drew the same
    share a world.
    """
    analysed = store.campaigns.get(analysis.campaign).spec
    if not varied(analysed):
        return [World(analysed, tuple(range(len(result.modes))), {})]
    found: dict[bytes, World] = {}
    for place, mode in enumerate(result.modes):
        drawn = drawn_by_medoid(store, analysis, mode)
        key = msgspec.json.encode(drawn, order="deterministic")
        before = found.get(key, World(in_scenario(analysed, drawn), (), drawn))
        found[key] = before._replace(modes=(*before.modes, place))
    return list(found.values())


def varied(spec: CampaignSpec) -> tuple[str, ...]:
    """The scenario parameters that each episode draws anew."""
    given = spec.scenario_parameters.items()
    return tuple(name for name, value in given if is_distribution(value))


def is_distribution(value: Any) -> bool:
    """Whether a scenario parameter is drawn for each episode."""
    return isinstance(value, dict) and not KINDS.keys().isdisjoint(value)


def drawn_by_medoid(store: Store, analysis: Analysis, mode: FailureMode) -> dict[str, Any]:
    """What the medoid of a mode drew of its scenario's parameters, by name."""
    spec = store.campaigns.get(mode.medoid_campaign or analysis.campaign).spec
    return drawn_for(spec, episode_seed(spec.seed, mode.medoid))


def in_scenario(spec: CampaignSpec, parameters: dict[str, Any]) -> CampaignSpec:
    """The campaign with other parameters of its scenario put over its own."""
    together = {**spec.scenario_parameters, **parameters}
    return msgspec.structs.replace(spec, scenario_parameters=together)


def refuse_several(store: Store, analysis: Analysis) -> None:
    """Make sure that all failures of an analysis are of one world.

    Raises:
        Conflict: its campaigns differ in their scenario, its parameters, planner or simulator.
    """
    numbers = (analysis.campaign, *analysis.settings.campaigns)
    first, *others = (world(store.campaigns.get(each).spec) for each in numbers)
    differing = [name for name in WORLD if any(each[name] != first[name] for each in others)]
    if differing:
        raise Conflict(
            f"Analysis {analysis.id} is of campaigns that differ in {', '.join(differing)}: there"
            " is no one scenario and planner to replay all of its modes with.",
            "Analyse each campaign by itself, and prove that analysis.",
        )


def world(spec: CampaignSpec) -> dict[str, Any]:
    """What makes a campaign's world, defaults of its scenario included."""
    parameters = defaults(spec) | spec.scenario_parameters
    return {**{name: getattr(spec, name) for name in WORLD}, "scenario_parameters": parameters}


def defaults(spec: CampaignSpec) -> dict[str, Any]:
    """What the scenario's parameters are unless a campaign says otherwise."""
    if spec.simulator in (functions.SIMULATOR, bridges.SIMULATOR):
        return {}
    return defaults_of(plugins.load(plugins.SCENARIOS, spec.scenario).Parameters)
