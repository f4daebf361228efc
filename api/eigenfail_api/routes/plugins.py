"""Routes of plug-ins: methods, planners, scenarios and simulators."""

import inspect
from collections.abc import Callable, Iterable
from typing import Annotated, Any

import msgspec
from fastapi import APIRouter, Path

from eigenfail import plugins, worlds
from eigenfail.errors import InvalidValue, NotFound
from eigenfail.values.records import Page
from eigenfail.wire.http import PREFIX, PluginInfo
from eigenfail_api.openapi import document_route
from eigenfail_api.parameters import Json

router = APIRouter(prefix=PREFIX, tags=["plug-ins"])

Listed = document_route(Page[PluginInfo])
One = document_route(PluginInfo)
Name = Annotated[str, Path(max_length=200, description="Name of the plug-in, as listed.")]


@router.get("/methods", **Listed)
def list_methods() -> Json:
    """List methods, with the JSON schema of their settings."""
    return _answer_list(plugins.METHODS, settings_of)


@router.get("/planners", **Listed)
def list_planners() -> Json:
    """List planners, with the JSON schema of their settings."""
    return _answer_list(plugins.PLANNERS, settings_of)


@router.get("/scenarios", **Listed)
def list_scenarios() -> Json:
    """List scenarios, with the JSON schema of their parameters."""
    return _answer_list(plugins.SCENARIOS, parameters_of)


@router.get("/simulators", **Listed)
def list_simulators() -> Json:
    """List simulators by name; they have no settings."""
    return Json(Page(tuple(map(PluginInfo, worlds.list_simulators()))))


@router.get("/methods/{name}", **One)
def get_method(name: Name) -> Json:
    """Get a method, with the JSON schema of its settings."""
    return Json(_find_plugin(plugins.METHODS, name, settings_of))


@router.get("/planners/{name}", **One)
def get_planner(name: Name) -> Json:
    """Get a planner, with the JSON schema of its settings."""
    return Json(_find_plugin(plugins.PLANNERS, name, settings_of))


@router.get("/scenarios/{name}", **One)
def get_scenario(name: Name) -> Json:
    """Get a scenario, with the JSON schema of its parameters."""
    return Json(_find_plugin(plugins.SCENARIOS, name, parameters_of))


@router.get("/simulators/{name}", **One)
def get_simulator(name: Name) -> Json:
    """Get a simulator: its name."""
    return Json(PluginInfo(_check_name("simulator", name, worlds.list_simulators())))


def settings_of(plugin: Any) -> Any:
    """Return the type of the settings of a method or a planner."""
    return plugin.Settings


def parameters_of(plugin: Any) -> Any:
    """Return the type of the parameters of a scenario."""
    return plugin.Parameters


def _answer_list(group: str, kind: Callable[[Any], Any]) -> Json:
    return Json(Page(tuple(describe_plugin(group, name, kind) for name in plugins.names(group))))


def _find_plugin(group: str, name: str, kind: Callable[[Any], Any]) -> PluginInfo:
    """Return a plug-in of a group.

    Raises:
        NotFound: the group has none of that name.
    """
    what = group.removeprefix("eigenfail.").removesuffix("s")
    return describe_plugin(group, _check_name(what, name, plugins.names(group)), kind)


def _check_name(what: str, name: str, names: Iterable[str]) -> str:
    """Return a name if it exists.

    Raises:
        NotFound: it does not.
    """
    if name not in (there := sorted(names)):
        raise NotFound(f"There is no {what} '{name}'.", f"Known: {', '.join(there)}.")
    return name


def describe_plugin(group: str, name: str, kind: Callable[[Any], Any]) -> PluginInfo:
    """Describe a plug-in, or say why it cannot be loaded."""
    try:
        plugin = plugins.load(group, name)
    except InvalidValue as error:
        # One plug-in that cannot be loaded must not cost the whole list.
        return PluginInfo(name, problem=error.problem)
    summary = (inspect.getdoc(plugin) or "").partition("\n")[0]
    return PluginInfo(name, summary, msgspec.json.schema(kind(plugin)))
