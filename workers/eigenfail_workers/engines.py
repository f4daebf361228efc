"""Which engine runs the episodes of a campaign. Registered as the default engine."""

from collections.abc import Callable

from eigenfail import functions
from eigenfail.contracts import EpisodeEngine
from eigenfail.values import EpisodeSetup
from eigenfail_workers.engine import Engine
from eigenfail_workers.functions.engine import from_setup

ENGINES: dict[str, Callable[[EpisodeSetup], EpisodeEngine]] = {functions.SIMULATOR: from_setup}
"""Simulators that drive nothing, by name; all others are driven."""


def make_engine(setup: EpisodeSetup) -> EpisodeEngine:
    """The engine for what all episodes of a campaign share.

    Raises:
        UnknownName: a plug-in, setting or parameter that does not exist.
        InvalidValue: a setting or parameter outside its bounds.
    """
    return ENGINES.get(setup.simulator, Engine)(setup)
