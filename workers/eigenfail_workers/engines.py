"""Which engine runs the episodes of a campaign. Registered as the default engine."""

from collections.abc import Callable

from eigenfail import bridges, functions
from eigenfail.contracts import EpisodeEngine
from eigenfail.values import EpisodeSetup
from eigenfail_workers.bridge.engine import from_setup as on_a_bridge
from eigenfail_workers.engine import Engine
from eigenfail_workers.functions.engine import from_setup as on_a_function

ENGINES: dict[str, Callable[[EpisodeSetup], EpisodeEngine]] = {
    functions.SIMULATOR: on_a_function,
    bridges.SIMULATOR: on_a_bridge,
}
"""Simulators that are no plug-ins, by name."""


def make_engine(setup: EpisodeSetup) -> EpisodeEngine:
    """The engine for what all episodes of a campaign share.

    Raises:
        UnknownName: a plug-in, setting or parameter that does not exist.
        InvalidValue: a setting or parameter outside its bounds.
    """
    return ENGINES.get(setup.simulator, Engine)(setup)
