"""Planners, scenarios and simulators of the core: those of plug-ins have tests of their own."""

from eigenfail import plugins


def list_core_names(group: str) -> list[str]:
    """The names that the core registers in a group of entry points, sorted."""
    return [name for name in plugins.names(group) if plugins.is_built_in(group, name)]
