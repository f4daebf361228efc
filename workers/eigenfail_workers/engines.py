"""The default engine of episodes, chosen by the simulator of a campaign."""

from collections.abc import Callable

from eigenfail import bridges, functions
from eigenfail.contracts import EpisodeEngine
from eigenfail.values.episode import EpisodeSetup
from eigenfail_workers.bridge.engine import make_bridge_engine
from eigenfail_workers.engine import Engine
from eigenfail_workers.functions import make_function_engine

ENGINES: dict[str, Callable[[EpisodeSetup], EpisodeEngine]] = {
    functions.SIMULATOR: make_function_engine,
    bridges.SIMULATOR: make_bridge_engine,
}
"""Engines of the simulators that are not plug-ins, by name."""


def make_engine(setup: EpisodeSetup) -> EpisodeEngine:
    """Return the engine of a campaign.

    Raises:
        UnknownName: a plug-in, setting or parameter does not exist.
        InvalidValue: a setting or parameter is outside its bounds.
    """
    # Any other name is a plug-in's, and `Engine` refuses one that is not installed.
    return ENGINES.get(setup.simulator, Engine)(setup)
