"""The abilities of a method, read from the class that its entry point names."""

from collections.abc import Mapping, Sequence
from math import ceil
from typing import Any

import msgspec

from eigenfail import plugins
from eigenfail.contracts import MethodTraits, Paced
from eigenfail.errors import EigenfailError
from eigenfail.settings import read_settings
from eigenfail.values import learning
from eigenfail.values.campaign import Campaign
from eigenfail.values.campaign_spec import CampaignSpec

ROUND_SIZE = "round_size"
"""A setting that methods without `round_sizes` are taken to keep to."""

UNDECLARED = MethodTraits()


class MethodDescription(msgspec.Struct, frozen=True):
    """A method as its class describes it.

    Attributes:
        name: name of its entry point.
        plugin: the method itself, which makes learners.
        traits: its declared traits.
        estimates: whether its learners estimate the failure probability.
        weighs: whether its learners compute the density of their proposals.
        exploits: whether its learners can be used without further learning.
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

    def find_round_sizes(self, settings: Any, episodes: int) -> learning.RoundSizes | None:
        """Return the sizes of its rounds; None if neither the method nor a setting gives them."""
        if isinstance(self.plugin, Paced):
            return self.plugin.round_sizes(settings, episodes)
        size = getattr(settings, ROUND_SIZE, None)
        return None if size is None else learning.RoundSizes(size, size, ROUND_SIZE)

    def count_rounds_ahead(self, parallel: int | None, round_size: int) -> int:
        """Return how many rounds are open besides the oldest one, without stop rules on results."""
        wanted = parallel if self.traits.tolerates_delay else None
        return learning.count_rounds_ahead(wanted, round_size, self.lookahead)


def describe_method(name: str) -> MethodDescription:
    """Return the description of a method.

    Raises:
        UnknownName: no method of that name; the known names are listed.
        InvalidValue: the method exists, but cannot be loaded.
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

    None if the number is not known: its method is not installed here or has members, or stop rules
    on results keep fewer rounds open.
    """
    # Such rules keep fewer rounds open, and how many depends on the results.
    if spec.stop.judges_results:
        return None
    try:
        description = describe_method(spec.method)
        sizes = _find_sizes(description, spec)
    except EigenfailError:
        return None
    if sizes is None or description.traits.has_members:
        return None
    return min(_count_open(description, sizes, spec.parallel), spec.episodes)


def _count_open(
    description: MethodDescription, sizes: learning.RoundSizes, parallel: int | None
) -> int:
    if sizes.width is None:
        # The oldest round, and those that are open besides it.
        return sizes.later * (1 + description.count_rounds_ahead(parallel, sizes.later))
    if parallel is None:
        return sizes.width
    return min(learning.OPEN_GROUPS * learning.choose_group_size(parallel), sizes.width)


def _find_sizes(description: MethodDescription, spec: CampaignSpec) -> learning.RoundSizes | None:
    settings = description.read_settings(spec.settings, "settings")
    return description.find_round_sizes(settings, spec.episodes)


class NarrowCampaign(msgspec.Struct, frozen=True):
    """A running campaign that, with all others, has too few open episodes for the workers.

    Attributes:
        campaign: its id.
        found: its number of parallel episodes, and the number of workers, in words.
        remedy: the setting to change.
    """

    campaign: int
    found: str
    remedy: str


def find_narrow_campaigns(running: Sequence[Campaign], workers: int) -> tuple[NarrowCampaign, ...]:
    """Return the running campaigns if all their open episodes together are too few.

    Some workers are then idle. The result is empty if the number of open episodes of any campaign
    is not known, such as of an ensemble.

    Args:
        running: all running campaigns.
        workers: number of connected workers.
    """
    known = [(each, count_open_episodes(each.spec)) for each in running]
    opened = [count for _, count in known if count is not None]
    # Advice that may be wrong is worse than none: one campaign that is not known settles it.
    if not known or len(opened) < len(known) or sum(opened) >= workers:
        return ()
    share = ceil(workers / len(known))
    return tuple(
        NarrowCampaign(
            each.id,
            f"runs at most {count} episodes at a time, and {workers} workers are connected",
            _advise_parallel(each.spec, share),
        )
        for each, count in known
    )


def _advise_parallel(spec: CampaignSpec, workers: int) -> str:
    """Return how a campaign could use a number of workers."""
    description = describe_method(spec.method)
    sizes = _find_sizes(description, spec)
    width = sizes.width if sizes else None
    if not description.traits.tolerates_delay or (width is not None and width < workers):
        return "run several seeds side by side: eigenfail run --seeds N"
    if spec.episodes <= learning.IN_FLIGHT * workers:
        return "it has too few episodes for all of them"
    advice = f"to use all of them, launch it with parallel = {workers}"
    smallest = ceil(learning.IN_FLIGHT * workers / learning.MOST_OPEN_ROUNDS)
    if sizes and sizes.later < smallest:
        return f"{advice} and {sizes.setting} {smallest} or more"
    return advice


def traits_of(name: str) -> MethodTraits:
    """Return the declared traits of a method.

    A method that is not installed here has the default traits, which claim nothing: its rates are
    without an interval.
    """
    try:
        return describe_method(name).traits
    except EigenfailError:
        return UNDECLARED
