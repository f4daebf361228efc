"""What the scenarios of this machine made of an episode's seed."""

from typing import Any

from eigenfail import bridges, plugins
from eigenfail.errors import InputError
from eigenfail.values import CampaignSpec
from eigenfail.values.variation import Variation, read_variation


def variation_of(spec: CampaignSpec) -> Variation:
    """The scenario parameters of a campaign, each fixed or drawn.

    Raises:
        UnknownName: no such scenario, or it has no such parameter or distribution.
        InvalidValue: a parameter, or an end of its distribution, outside its bounds.
    """
    if spec.simulator == bridges.SIMULATOR:
        return bridges.variation(spec.scenario_parameters)
    scenario = plugins.load(plugins.SCENARIOS, spec.scenario)
    return read_variation(scenario.Parameters, spec.scenario_parameters)


def drawn_for(spec: CampaignSpec, seed: int) -> dict[str, Any]:
    """The scenario parameters that an episode drew, by name; none where the scenario is unknown."""
    try:
        return variation_of(spec).drawn(seed)
    except InputError:
        return {}
