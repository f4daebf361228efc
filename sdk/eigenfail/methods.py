"""What a method can do, read once from the class that its entry point names."""

from collections.abc import Mapping
from typing import Any

import msgspec

from eigenfail import plugins
from eigenfail.contracts import MethodTraits, Paced
from eigenfail.errors import EigenfailError
from eigenfail.settings import read_settings
from eigenfail.values import CampaignSpec, RoundSizes
from eigenfail.values.learning import count_rounds_ahead

ROUND_SIZE = "round_size"
"""A setting that methods without `round_sizes` are taken to keep to."""

UNDECLARED = MethodTraits()


class MethodDescription(msgspec.Struct, frozen=True):
    """A method as its class describes it.

    Attributes:
        name: name of its entry point.
        plugin: makes learners.
        traits: what it declares of itself.
        estimates: whether its learners estimate the failure probability.
        weighs: whether its learners know the density of what they propose.
        exploits: whether what its learners know can be used without learning on.
        lookahead: rounds that are open besides the oldest one.
    """

    name: str
    plugin: Any
    traits: MethodTraits
    estimates: bool
    weighs: bool
    exploits: bool
    lookahead: int

    @property
    def settings_type(self) -> type[msgspec.Struct]:
        """The type of its settings."""
        kind: type[msgspec.Struct] = self.plugin.Settings
        return kind

    def read_settings(self, given: Mapping[str, Any], field: str) -> Any:
        """Return the settings of the method from what a user gave.

        Raises:
            UnknownName: a setting that the method does not have.
            InvalidValue: a value of the wrong type or outside its bounds.
        """
        return read_settings(self.settings_type, dict(given), field)

    def find_round_sizes(self, settings: Any, episodes: int) -> RoundSizes | None:
        """Return how large its rounds are; None if neither the method nor a setting says."""
        if isinstance(self.plugin, Paced):
            return self.plugin.round_sizes(settings, episodes)
        size = getattr(settings, ROUND_SIZE, None)
        return None if size is None else RoundSizes(size, size, ROUND_SIZE)

    def count_rounds_ahead(self, parallel: int | None, round_size: int) -> int:
        """Return how many rounds are open besides the oldest one, without rules on results."""
        wanted = parallel if self.traits.tolerates_delay else None
        return count_rounds_ahead(wanted, round_size, self.lookahead)


def describe_method(name: str) -> MethodDescription:
    """Return the description of a method.

    Raises:
        UnknownName: no method of that name; the known ones are listed.
        InvalidValue: the method is there, but cannot be loaded.
    """
    plugin = plugins.load(plugins.METHODS, name)
    declared = getattr(plugin, "traits", None)
    return MethodDescription(
        name=name,
        plugin=plugin,
        traits=declared if isinstance(declared, MethodTraits) else UNDECLARED,
        estimates=hasattr(plugin, "estimate"),
        weighs=hasattr(plugin, "weigh"),
        # Of the learners that a plain function makes nothing is known before there is one.
        exploits=not isinstance(plugin, type) or hasattr(plugin, "exploit"),
        lookahead=getattr(plugin, "lookahead", 1),
    )


def count_open_episodes(spec: CampaignSpec) -> int | None:
    """Return how many episodes of a campaign are open at a time, and so may run.

    None where that is not known: its method is not installed here or has members, or stop rules on
    results keep fewer rounds open.
    """
    if spec.stop.judges_results:
        return None
    try:
        description = describe_method(spec.method)
        sizes = description.find_round_sizes(
            description.read_settings(spec.settings, "settings"), spec.episodes
        )
    except EigenfailError:
        return None
    if sizes is None or description.traits.has_members:
        return None
    opened = sizes.later * (1 + description.count_rounds_ahead(spec.parallel, sizes.later))
    return min(opened, sizes.width or opened, spec.episodes)


def traits_of(name: str) -> MethodTraits:
    """Return what a method declares of itself.

    A method that is not installed here has the defaults, which claim nothing: its rates have no
    interval.
    """
    try:
        return describe_method(name).traits
    except EigenfailError:
        return UNDECLARED
