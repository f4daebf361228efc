"""Any Python function of a noise trajectory as a system under test; docs/any_function.md.

A campaign has `simulator` and `scenario` "function", and as its `planner` a `module:function`.
"""

import ast
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from difflib import get_close_matches
from functools import update_wrapper
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import find_spec
from pathlib import Path
from shlex import quote
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta
from msgspec.structs import replace
from numpy.typing import NDArray

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.settings import read_settings
from eigenfail.values.analysis import JOINT, LONGEST_CHANNEL
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.channels import MOST_CHANNELS
from eigenfail.values.disturbance import AXES, DisturbanceModel
from eigenfail.values.shapes import Correlated, White

SIMULATOR = SCENARIO = "function"
"""What a campaign names as its simulator and its scenario, if a function is under test."""

PLACE = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*")
LIMIT_S = 30.0

CHANNEL_NAME = re.compile(rf"[a-z][a-z0-9_]{{0,{LONGEST_CHANNEL - 1}}}")
TAKEN = (JOINT, "step", "log_probability")
CHANNEL_RULE = (
    f"Take lower case letters, digits and underscores, a letter first, at most {LONGEST_CHANNEL} "
    f"of them; none of {', '.join(map(repr, TAKEN))}, nor a name that ends in '_sigma' or '_z'."
)
CHANNELS_FIELD = "scenario_parameters.channels"
MOST_VALUES = 100_000
"""Steps times channels: a round of such trajectories still fits a message."""

ALLOWED_VARIABLE = "EIGENFAIL_FUNCTIONS"
"""Modules and packages whose functions may be named, with commas; not set: none."""

NAMESPACE_ACCESS = frozenset({"exec", "globals", "locals", "setattr", "vars"})
"""Built-in functions by which a module can bind names that its source does not spell out."""

Noise = NDArray[np.float64]


class FunctionParameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The `scenario_parameters` of a campaign on a function."""

    steps: Annotated[int, Meta(ge=1, le=10_000, description="steps of a noise trajectory")]
    limit_s: Annotated[
        float, Meta(gt=0.0, le=50.0, description="time that one call may take [s]")
    ] = LIMIT_S
    channels: Annotated[
        tuple[str, ...],
        Meta(
            min_length=1,
            max_length=MOST_CHANNELS,
            description="names of the components of the noise at each step",
        ),
    ] = AXES


class FunctionUnderTest:
    """A function that is declared as a system under test; a call calls the function itself.

    Args:
        function: maps noise, shape (*leading, steps, channels) [sigma], to robustness, shape
            (*leading,).
        leading: leading shape: (), or (1,) for a function of a batch.
    """

    def __init__(self, function: Callable[..., Any], leading: tuple[int, ...]) -> None:
        update_wrapper(self, function, updated=())
        self._function = function
        self.leading = leading

    def __call__(self, z: Noise) -> Any:
        """Return the function's result."""
        return self._function(z)


def of_trajectory(function: Callable[[Noise], Any]) -> FunctionUnderTest:
    """Declare a function of one noise trajectory, shape (steps, channels) [sigma], as under test.

    It returns the robustness, one finite number; 0 or less is a failure.
    """
    return FunctionUnderTest(function, ())


def of_batch(function: Callable[[Noise], Any]) -> FunctionUnderTest:
    """Declare a function of n trajectories, shape (n, steps, channels) [sigma], as under test.

    It returns their robustness, shape (n,). It receives one episode at a time, n = 1: the last bits
    of many batched products depend on n, but an episode must not.
    """
    return FunctionUnderTest(function, (1,))


def check(spec: CampaignSpec) -> FunctionParameters:
    """Return the parameters of a campaign on a function, without a search for the function.

    Raises:
        UnknownName: a parameter does not exist.
        InvalidValue: a value is outside its bounds, or does not apply to a function.
    """
    if spec.scenario != SCENARIO:
        problem = f"'{spec.scenario}' is not a scenario of the simulator '{SIMULATOR}'."
        raise InvalidValue("scenario", problem, f'Write scenario = "{SCENARIO}".')
    if not PLACE.fullmatch(spec.planner):
        problem = f"'{spec.planner}' is not of the form module:function."
        raise InvalidValue("planner", problem, 'Write it as planner = "my_module:robustness".')
    # A function takes noise alone.
    if spec.planner_settings:
        raise UnknownName("planner_settings", next(iter(spec.planner_settings)), ())
    # Whatever else is set would be ignored, and its author would not know.
    plain = replace(spec.disturbance, scale=1.0, shape=White())
    if plain != DisturbanceModel():
        remedy = "Set `scale` and `shape` alone: there is no distance that sigma could grow with."
        raise InvalidValue("disturbance", "slopes and bases do not apply to functions.", remedy)
    given = read_settings(FunctionParameters, spec.scenario_parameters, "scenario_parameters")
    _check_channels(given)
    if isinstance(spec.disturbance.shape, Correlated) and given.channels != AXES:
        problem = f"ar1 correlates {AXES[0]} and {AXES[1]} noise only, and channels are named here."
        remedy = "Take white or student_t, or leave `channels` out."
        raise InvalidValue("disturbance.shape", problem, remedy)
    return given


def _check_channels(given: FunctionParameters) -> None:
    if len(set(given.channels)) < len(given.channels):
        raise InvalidValue(
            CHANNELS_FIELD, "two channels have one name.", "Give each a name of its own."
        )
    for name in given.channels:
        if not CHANNEL_NAME.fullmatch(name):
            problem = f"'{name}' is not a valid name of a channel."
            raise InvalidValue(CHANNELS_FIELD, problem, CHANNEL_RULE)
        # An analysis takes "joint" for all channels; tables have columns with the other names.
        if name in TAKEN or name.endswith(("_sigma", "_z")):
            problem = f"'{name}' has another meaning in analyses or tables."
            raise InvalidValue(CHANNELS_FIELD, problem, CHANNEL_RULE)
    values = given.steps * len(given.channels)
    if values > MOST_VALUES:
        problem = f"{given.steps} steps of {len(given.channels)} channels are {values:,} values."
        raise InvalidValue(CHANNELS_FIELD, problem, f"Stay at {MOST_VALUES:,} or less.")


def require_module(place: str) -> None:
    """Check, before anything is started here, that the module can be found; nothing is run.

    Raises:
        InvalidValue: it is not in this folder, on PYTHONPATH or installed, or its source does not
            define the function.
    """
    package = place.partition(":")[0].partition(".")[0]
    look_in_this_folder()
    if find_spec(package) is None:
        raise make_import_error(place, f"there is no module '{package}'")
    refuse_undefined(place)


def refuse_undefined(place: str) -> None:
    """Refuse a name that its module's source does not bind at the top level; nothing is run.

    If the source cannot be found or parsed here, or may bind names that do not appear in it, the
    workers decide.

    Raises:
        InvalidValue: no top-level statement of the module defines, assigns or imports the name.
    """
    module, _, name = place.partition(":")
    tree = _parse_source(module)
    if tree is None or _binds_unseen_names(tree):
        return
    known = set(_list_bound_names(tree))
    if name not in known and "__getattr__" not in known:
        near = " or ".join(f"'{each}'" for each in get_close_matches(name, sorted(known)))
        remedy = f"Did you mean {near}?" if near else "Correct the name behind the colon."
        raise InvalidValue("planner", f"module '{module}' has no '{name}'.", remedy)


def _parse_source(module: str) -> ast.Module | None:
    """Return the syntax tree of a module's source file; None if it cannot be read."""
    try:
        spec = _find_without_import(module)
        if spec is None or not spec.has_location or not str(spec.origin).endswith(".py"):
            return None
        return ast.parse(Path(str(spec.origin)).read_bytes())
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):
        return None


def _find_without_import(module: str) -> ModuleSpec | None:
    """Find a module as workers do, without `find_spec`'s import of the packages above it.

    Raises:
        ValueError: the module is loaded, but does not state its source.
    """
    top, *below = module.split(".")
    spec = find_spec(top) or PathFinder.find_spec(top, [str(Path.cwd())])
    for part in below:
        if spec is None or spec.submodule_search_locations is None:
            return None
        # By its last name alone: with a full one, the packages above would have to be loaded.
        spec = PathFinder.find_spec(part, list(spec.submodule_search_locations))
    return spec


def _binds_unseen_names(tree: ast.Module) -> bool:
    """Return whether a module may bind names that do not appear in its source."""
    nodes = tuple(ast.walk(tree))
    used = {node.id for node in nodes if isinstance(node, ast.Name)}
    # What a star brings is known only once the other module has run.
    stars = (node.names[0].name == "*" for node in nodes if isinstance(node, ast.ImportFrom))
    return any(stars) or not used.isdisjoint(NAMESPACE_ACCESS)


def _list_bound_names(node: ast.AST) -> Iterator[str]:
    """Yield the names that a tree binds outside the bodies of its functions and classes."""
    for inner in ast.iter_child_nodes(node):
        match inner:
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                yield inner.name
                # `global` in a body binds a name of the module.
                bodies = (each for each in ast.walk(inner) if isinstance(each, ast.Global))
                yield from (name for each in bodies for name in each.names)
                continue
            case ast.Import() | ast.ImportFrom():
                yield from (each.asname or each.name.partition(".")[0] for each in inner.names)
            case ast.Name(ctx=ast.Store()):
                yield inner.id
            case ast.MatchAs(name=str(name)) | ast.MatchStar(name=str(name)):
                yield name
            case ast.MatchMapping(rest=str(name)):
                yield name
        yield from _list_bound_names(inner)


def refuse_unlisted(place: str, remedy: str = "") -> None:
    """Refuse a function whose module this process may not import.

    Campaigns come from requests, and an import runs code: no request can extend the list.

    Args:
        place: `module:function`.
        remedy: remedy for the error if this process is not part of a service.

    Raises:
        InvalidValue: neither the module nor a package around it is on the list.
    """
    if not is_listed(place):
        module = place.partition(":")[0]
        problem = f"'{module}' is not in the list of modules whose functions may be run here."
        of_service = (
            f"Start the service with `eigenfail up --functions {module}`, or it and its workers "
            f"with {ALLOWED_VARIABLE}={module}."
        )
        raise InvalidValue("planner", problem, remedy or of_service)


def is_listed(place: str) -> bool:
    """Return whether the module, or a package around it, may be imported here."""
    module, listed = place.partition(":")[0], os.environ.get(ALLOWED_VARIABLE, "")
    # With a dot behind both, so that `plan` does not list `planner`.
    return any(f"{module}.".startswith(f"{name.strip()}.") for name in listed.split(","))


def up_option() -> str:
    """Return the option of `eigenfail up` for the same list, after a space; empty if not set."""
    listed = os.environ.get(ALLOWED_VARIABLE)
    return f" --functions {quote(listed)}" if listed else ""


def allow(places: str) -> None:
    """Set the modules that this process, and processes that it starts later, may import.

    Args:
        places: modules and packages, separated by commas.

    Raises:
        InvalidValue: one of them is not a valid module name.
    """
    for name in places.split(","):
        if not all(part.isidentifier() for part in name.strip().split(".")):
            problem = f"'{name.strip()}' is not a valid module name."
            raise InvalidValue("--functions", problem, "Write --functions my_module,my_package.")
    os.environ[ALLOWED_VARIABLE] = places


def allow_functions(specs: Iterable[CampaignSpec]) -> None:
    """Allow the modules of the given campaigns, in a service that is started only for them.

    The user who starts that service chose the file of the campaigns. If the environment variable
    lists modules already, that list does not change.
    """
    places = [spec.planner for spec in specs if spec.simulator == SIMULATOR]
    modules = sorted({place.partition(":")[0] for place in places if PLACE.fullmatch(place)})
    if modules:
        # In the environment, which workers inherit.
        os.environ.setdefault(ALLOWED_VARIABLE, ",".join(modules))


def look_in_this_folder() -> None:
    """Add the working folder to the end of the module search path."""
    if (here := str(Path.cwd())) not in sys.path:
        # At the end: a file of this folder must not replace an installed module of its name.
        sys.path.append(here)


def make_import_error(place: str, why: str) -> InvalidValue:
    """Return the error of a function whose module cannot be imported."""
    return InvalidValue(
        "planner",
        f"'{place}' cannot be imported: {why}.",
        f"Workers look in their working folder ({Path.cwd()}), on PYTHONPATH and among installed "
        "packages: start the service in the module's folder, or install it where the workers are.",
    )
