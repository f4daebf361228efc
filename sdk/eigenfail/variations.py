"""What the scenarios of this machine made of an episode's seed."""

from typing import Any

from eigenfail import plugins
from eigenfail.errors import InputError
from eigenfail.values import CampaignSpec
from eigenfail.values.variation import read_variation


def drawn_for(spec: CampaignSpec, seed: int) -> dict[str, Any]:
    """The scenario parameters that an episode drew, by name; none where the scenario is unknown."""
    try:
        scenario = plugins.load(plugins.SCENARIOS, spec.scenario)
        return read_variation(scenario.Parameters, spec.scenario_parameters).drawn(seed)
    except InputError:
        return {}
