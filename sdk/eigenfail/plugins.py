"""Plug-ins by entry point: what outsiders add, and what one part of the house needs of another."""

import re
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from eigenfail.errors import InvalidValue, UnknownName

SIMULATORS = "eigenfail.simulators"
SCENARIOS = "eigenfail.scenarios"
PLANNERS = "eigenfail.planners"
METHODS = "eigenfail.methods"
ENGINES = "eigenfail.engines"
EXPLAINERS = "eigenfail.explainers"
WORKER_ACTORS = "eigenfail.worker_actors"

CLASS_PATH = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")


@cache
def registered(group: str) -> dict[str, EntryPoint]:
    """The entry points of a group by name."""
    return {point.name: point for point in entry_points(group=group)}


def names(group: str) -> list[str]:
    """The names registered in a group, sorted."""
    return sorted(registered(group))


@cache
def load(group: str, name: str) -> Any:
    """The object that a name stands for.

    Raises:
        UnknownName: nothing of that name; the known ones are listed.
        InvalidValue: the plug-in is there, but cannot be loaded.
    """
    field = group.removeprefix("eigenfail.").removesuffix("s")
    point = registered(group).get(name)
    if point is None:
        raise UnknownName(field, name, names(group))
    try:
        return point.load()
    except (ImportError, AttributeError) as error:
        remedy = "Install what it needs, or take its package out."
        raise InvalidValue(field, f"'{name}' cannot be loaded: {error}.", remedy) from error


def load_class(path: str) -> Any:
    """The object at `module:Class`: for the command line alone, never for what a request says.

    Raises:
        InvalidValue: not a path of that form, or nothing there.
    """
    if not CLASS_PATH.fullmatch(str(path)):
        raise InvalidValue(
            "plug-in",
            f"'{path}' is not of the form module:Class.",
            "Write it as my_planner:Planner.",
        )
    module, name = path.split(":")
    try:
        return getattr(import_module(module), name)
    except (ImportError, AttributeError) as error:
        problem = f"'{path}' cannot be loaded: {error}."
        remedy = "Run it from the folder of the module, or install that."
        raise InvalidValue("plug-in", problem, remedy) from error
