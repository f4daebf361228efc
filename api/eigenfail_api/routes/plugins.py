"""What campaigns can name: methods, planners, scenarios, simulators."""

import inspect
from collections.abc import Callable, Iterable
from typing import Annotated, Any

import msgspec
from fastapi import APIRouter, Path

from eigenfail import functions, plugins
from eigenfail.errors import InvalidValue, NotFound
from eigenfail.values import Page
from eigenfail.wire.http import PREFIX, PluginInfo
from eigenfail_api.bodies import Json
from eigenfail_api.schemas import documented

router = APIRouter(prefix=PREFIX, tags=["plug-ins"])

Listed = documented(Page[PluginInfo])
One = documented(PluginInfo)
Name = Annotated[str, Path(max_length=200, description="Its name, as the list has it.")]


@router.get("/methods", **Listed)
def list_methods() -> Json:
    """Methods, with the JSON schema of their settings."""
    return listing(plugins.METHODS, settings_of)


@router.get("/planners", **Listed)
def list_planners() -> Json:
    """Planners, with the JSON schema of their settings."""
    return listing(plugins.PLANNERS, settings_of)


@router.get("/scenarios", **Listed)
def list_scenarios() -> Json:
    """Scenarios, with the JSON schema of their parameters."""
    return listing(plugins.SCENARIOS, parameters_of)


@router.get("/simulators", **Listed)
def list_simulators() -> Json:
    """Simulators; they have no settings, and are too heavy to be loaded here."""
    return Json(Page(tuple(map(PluginInfo, functions.simulators()))))


@router.get("/methods/{name}", **One)
def get_method(name: Name) -> Json:
    """A method, with the JSON schema of its settings."""
    return Json(single(plugins.METHODS, name, settings_of))


@router.get("/planners/{name}", **One)
def get_planner(name: Name) -> Json:
    """A planner, with the JSON schema of its settings."""
    return Json(single(plugins.PLANNERS, name, settings_of))


@router.get("/scenarios/{name}", **One)
def get_scenario(name: Name) -> Json:
    """A scenario, with the JSON schema of its parameters."""
    return Json(single(plugins.SCENARIOS, name, parameters_of))


@router.get("/simulators/{name}", **One)
def get_simulator(name: Name) -> Json:
    """A simulator, by its name alone."""
    return Json(PluginInfo(known("simulator", name, functions.simulators())))


def settings_of(plugin: Any) -> Any:
    """The settings of a method or a planner."""
    return plugin.Settings


def parameters_of(plugin: Any) -> Any:
    """The parameters of a scenario."""
    return plugin.Parameters


def listing(group: str, kind: Callable[[Any], Any]) -> Json:
    """All plug-ins of a group."""
    return Json(Page(tuple(described(group, name, kind) for name in plugins.names(group))))


def single(group: str, name: str, kind: Callable[[Any], Any]) -> PluginInfo:
    """One plug-in of a group.

    Raises:
        NotFound: the group has none of that name.
    """
    what = group.removeprefix("eigenfail.").removesuffix("s")
    return described(group, known(what, name, plugins.names(group)), kind)


def known(what: str, name: str, names: Iterable[str]) -> str:
    """A name that is among those that there are.

    Raises:
        NotFound: it is not.
    """
    if name not in (there := sorted(names)):
        raise NotFound(f"There is no {what} '{name}'.", f"Known: {', '.join(there)}.")
    return name


def described(group: str, name: str, kind: Callable[[Any], Any]) -> PluginInfo:
    """A plug-in; one that cannot be loaded says why, and the others are listed all the same."""
    try:
        plugin = plugins.load(group, name)
    except InvalidValue as error:
        return PluginInfo(name, problem=error.problem)
    summary = (inspect.getdoc(plugin) or "").partition("\n")[0]
    return PluginInfo(name, summary, msgspec.json.schema(kind(plugin)))
