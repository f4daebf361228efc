"""What campaigns can name: methods, planners, scenarios, simulators."""

import inspect
from collections.abc import Callable
from typing import Any

import msgspec
from fastapi import APIRouter

from eigenfail import functions, plugins
from eigenfail.errors import InvalidValue
from eigenfail.values import Page
from eigenfail.wire.http import PREFIX, PluginInfo
from eigenfail_api.schemas import Json, documented

router = APIRouter(prefix=PREFIX, tags=["plug-ins"])

Listed = documented(Page[PluginInfo])


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


def settings_of(plugin: Any) -> Any:
    """The settings of a method or a planner."""
    return plugin.Settings


def parameters_of(plugin: Any) -> Any:
    """The parameters of a scenario."""
    return plugin.Parameters


def listing(group: str, kind: Callable[[Any], Any]) -> Json:
    """All plug-ins of a group."""
    return Json(Page(tuple(described(group, name, kind) for name in plugins.names(group))))


def described(group: str, name: str, kind: Callable[[Any], Any]) -> PluginInfo:
    """A plug-in; one that cannot be loaded says why, and the others are listed all the same."""
    try:
        plugin = plugins.load(group, name)
    except InvalidValue as error:
        return PluginInfo(name, problem=error.problem)
    summary = (inspect.getdoc(plugin) or "").partition("\n")[0]
    return PluginInfo(name, summary, msgspec.json.schema(kind(plugin)))
