"""Plug-ins by entry point: those of users, and those by which our own packages find each other."""

import logging
import re
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from eigenfail.errors import EigenfailError, InvalidValue, UnknownName, describe_error, read_text

SIMULATORS = "eigenfail.simulators"
SCENARIOS = "eigenfail.scenarios"
PLANNERS = "eigenfail.planners"
METHODS = "eigenfail.methods"
ENGINES = "eigenfail.engines"
EXPLAINERS = "eigenfail.explainers"
WORKER_ACTORS = "eigenfail.worker_actors"
COMMANDS = "eigenfail.commands"
DATABASE_TOOLS = "eigenfail.database_tools"

BUILT_IN = frozenset({"eigenfail_services", "eigenfail_workers"})
"""The packages whose plug-ins are eigenfail's own."""

CLASS_PATH = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")


@cache
def list_entry_points(group: str) -> dict[str, EntryPoint]:
    """The entry points of a group by name."""
    return {point.name: point for point in entry_points(group=group)}


def names(group: str) -> list[str]:
    """The names registered in a group, sorted."""
    return sorted(list_entry_points(group))


def is_built_in(group: str, name: str) -> bool:
    """Return whether eigenfail itself brings the plug-in of that name; not so of an unknown one."""
    point = list_entry_points(group).get(name)
    return point is not None and point.module.partition(".")[0] in BUILT_IN


@cache
def load(group: str, name: str) -> Any:
    """The object that a name stands for.

    Raises:
        UnknownName: nothing of that name; the known ones are listed.
        InvalidValue: the plug-in is there, but cannot be loaded.
    """
    field = group.removeprefix("eigenfail.").removesuffix("s")
    point = list_entry_points(group).get(name)
    if point is None:
        raise UnknownName(field, name, names(group))
    try:
        return point.load() if is_built_in(group, name) else _load_foreign(group, name)
    except EigenfailError:
        raise
    except (Exception, SystemExit) as error:
        problem = f"'{name}' cannot be loaded: {_describe_failure(error)}."
        remedy = "Install its dependencies, or uninstall its package."
        raise InvalidValue(field, problem, remedy) from error


def _describe_failure(error: BaseException) -> str:
    # The text alone names a missing module; other errors are unclear without their type.
    usual = isinstance(error, ImportError | AttributeError)
    return read_text(error) if usual else describe_error(error)


def keep_import_effects() -> None:
    """Leave process-wide state as the imports of plug-ins change it, from now on.

    For a process that runs the episodes of these plug-ins alone: they may rely on what they set.
    """
    global _keeps_import_effects  # noqa: PLW0603 - it is a property of this process
    _keeps_import_effects = True


_keeps_import_effects = False


def _load_foreign(group: str, name: str) -> Any:
    """Import a plug-in that is not eigenfail's own, and undo what that changes in this process.

    Controller and services import plug-ins only to read their settings, and compute for all
    campaigns: an import that sets the rounding mode must not change their results.
    """
    if _keeps_import_effects:
        return list_entry_points(group)[name].load()
    # numpy takes a tenth of a second, which a command without plug-ins does not spend.
    from eigenfail.process_state import ProcessState

    before = ProcessState()
    try:
        return list_entry_points(group)[name].load()
    finally:
        if changes := before.changes():
            before.restore()
            logging.getLogger(__name__).warning(
                "The import of the plug-in '%s' changed process-wide state, which was restored: %s",
                name,
                "; ".join(changes),
            )


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
    except (Exception, SystemExit) as error:
        problem = f"'{path}' cannot be loaded: {_describe_failure(error)}."
        remedy = "Run it from the folder of the module, or install that."
        raise InvalidValue("plug-in", problem, remedy) from error
