"""Plug-ins by entry point: of users, and of eigenfail's own packages to find each other."""

import logging
import re
from ast import literal_eval
from collections.abc import Iterable
from difflib import get_close_matches
from functools import cache
from importlib import import_module
from importlib.abc import InspectLoader
from importlib.machinery import PathFinder
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from io import StringIO
from tokenize import COMMENT, NL, STRING, TokenError, generate_tokens
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
ROUTES = "eigenfail.routes"
DATABASE_TOOLS = "eigenfail.database_tools"
EXPORTS = "eigenfail.exports"
TABLES = "eigenfail.tables"
TASKS = "eigenfail.tasks"
NOTEBOOKS = "eigenfail.notebooks"

NEEDED = {METHODS: "Settings", PLANNERS: "Settings", SCENARIOS: "Parameters"}
"""The attribute of a plug-in without which no campaign with it can be described, by group."""

BUILT_IN = frozenset({"eigenfail_services", "eigenfail_workers"})
"""The packages whose plug-ins are eigenfail's own."""

CLASS_PATH = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")


DISTRIBUTION = "eigenfail"
"""The distribution whose entry points are eigenfail's own."""

SEARCHES = ("annealing", "chains", "go_explore", "mixture_ce", "optuna")
PACKAGES = {METHODS: dict.fromkeys(SEARCHES, "eigenfail-searches")}
"""The packages under plugins/ that bring plug-ins of these names, by group and name.

A campaign file that names one gets the package to install, not a list of other methods.
"""


def list_groups() -> set[str]:
    """Return the groups of entry points that are read: the constants above."""
    values = (value for name, value in globals().items() if name.isupper())
    return {each for each in values if isinstance(each, str) and each.startswith("eigenfail.")}


def list_misspelt_groups() -> dict[str, str]:
    """Return installed entry-point groups that nothing reads, each with the group it resembles.

    Python ignores such groups without an error, since a package may write any name of a group.
    """
    known = {group.removeprefix("eigenfail."): group for group in list_groups()}
    found = {}
    for group in sorted(entry_points().groups - list_groups()):
        word = re.sub("^eigenfail[._-]", "", group)
        if word != group and (close := get_close_matches(word.replace("-", "_"), known, n=1)):
            found[group] = known[close[0]]
    return found


def list_claims(group: str) -> dict[str, list[EntryPoint]]:
    """Return all entry points of a group by name: several if distributions claim the same name."""
    claims: dict[str, list[EntryPoint]] = {}
    for point in entry_points(group=group):
        claims.setdefault(point.name, []).append(point)
    return claims


@cache
def list_entry_points(group: str) -> dict[str, EntryPoint]:
    """Return the entry points of a group by name."""
    return {name: points[0] for name, points in list_claims(group).items()}


def name_distribution(point: EntryPoint) -> str:
    """Return the name of the distribution that an entry point belongs to."""
    return point.dist.name if point.dist else point.module.partition(".")[0]


def describe_conflict(group: str, name: str, owners: Iterable[str]) -> InvalidValue:
    """Return the error for a name that several distributions claim.

    The choice would depend on the order of folders in `sys.path`, so the same campaign could run
    other code on another machine. So none is used.
    """
    owners = sorted(owners)
    others = [owner for owner in owners if owner != DISTRIBUTION]
    return InvalidValue(
        group.removeprefix("eigenfail.").removesuffix("s"),
        f"'{name}' is claimed by several packages: {', '.join(owners)}.",
        f"Uninstall one of them: pip uninstall {others[-1]}.",
    )


def names(group: str) -> list[str]:
    """Return the names registered in a group, sorted."""
    return sorted(list_entry_points(group))


def is_built_in(group: str, name: str) -> bool:
    """Return whether eigenfail itself brings the plug-in; False for an unknown name."""
    point = list_entry_points(group).get(name)
    return point is not None and point.module.partition(".")[0] in BUILT_IN


def describe_module(name: str) -> str:
    """Return the first line of a module's docstring as a sentence; empty if it cannot be read.

    The module is not imported: a list of commands must not wait for the modules of plug-ins, or
    fail with them.
    """
    try:
        first = _read_docstring(name).strip().partition("\n")[0]
    except (ImportError, OSError, SyntaxError, ValueError, TokenError):
        return ""
    first = re.sub("^`[^`]*`: ", "", first)
    return f"{first[:1].upper()}{first[1:]}"


def _read_docstring(name: str) -> str:
    top, *below = name.split(".")
    spec = find_spec(top)
    for part in below:
        # find_spec of a dotted name would import the packages above it.
        top = f"{top}.{part}"
        spec = PathFinder.find_spec(top, spec.submodule_search_locations) if spec else None
    loader = spec.loader if spec else None
    if not isinstance(loader, InspectLoader):
        return ""
    for token in generate_tokens(StringIO(loader.get_source(top) or "").readline):
        if token.type == STRING:
            return str(literal_eval(token.string))
        if token.type not in {COMMENT, NL}:
            break
    return ""


@cache
def load(group: str, name: str) -> Any:
    """Load the plug-in of a name.

    Raises:
        UnknownName: the name does not exist; the known names are listed.
        InvalidValue: the plug-in exists but cannot be loaded, or several packages claim its name.
    """
    field = group.removeprefix("eigenfail.").removesuffix("s")
    point = list_entry_points(group).get(name)
    if point is None:
        package = PACKAGES.get(group, {}).get(name)
        absent = f"'{name}' is in the package {package}, which is not installed here (in a clone: "
        new = f"'{name}' is not known. If its package is new, start the service again."
        unknown = "" if get_close_matches(name, names(group)) else new
        problem = f"{absent}pip install plugins/{package})." if package else unknown
        raise UnknownName(field, name, names(group), problem)
    if len(claims := list_claims(group).get(name, ())) > 1:
        raise describe_conflict(group, name, map(name_distribution, claims))
    try:
        plugin = point.load() if is_built_in(group, name) else _load_foreign(group, name)
    except EigenfailError:
        raise
    except (Exception, SystemExit) as error:
        problem = f"'{name}' cannot be loaded: {_describe_failure(error)}."
        remedy = "Install its dependencies, or uninstall its package."
        raise InvalidValue(field, problem, remedy) from error
    if (needed := NEEDED.get(group)) and not hasattr(plugin, needed):
        # Lists of plug-ins read it of each one: they must be able to leave out this one alone.
        problem = f"'{name}' cannot be loaded: {point.value} has no `{needed}`."
        remedy = f"Give it a class `{needed}` of msgspec.Struct, or uninstall its package."
        raise InvalidValue(field, problem, remedy)
    return plugin


def _describe_failure(error: BaseException) -> str:
    # The text alone names a missing module; other errors are unclear without their type.
    usual = isinstance(error, ImportError | AttributeError)
    return read_text(error) if usual else describe_error(error)


def keep_import_effects() -> None:
    """Keep changes to process-wide state by imports of plug-ins, from now on.

    Use it in a process that only runs episodes of such plug-ins: they may rely on their changes.
    """
    global _keeps_import_effects  # noqa: PLW0603 - it is a property of this process
    _keeps_import_effects = True


_keeps_import_effects = False


def _load_foreign(group: str, name: str) -> Any:
    """Import a plug-in that is not eigenfail's own, and undo its changes to process-wide state.

    Controller and services import plug-ins only to read their settings. They compute for all
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
    """Load the object at `module:Class`: only for the command line, never for a request.

    Raises:
        InvalidValue: not a path of that form, or the object does not exist.
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
        problem = f"'{path}' cannot be loaded: {_describe_failure(error).removesuffix('.')}."
        is_absent = isinstance(error, ModuleNotFoundError)
        remedy = "Run it from the folder of the module, or install that." if is_absent else ""
        raise InvalidValue("plug-in", problem, remedy) from error
