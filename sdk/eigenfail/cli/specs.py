"""Campaigns from TOML files, refused before anything is started."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from eigenfail import bridges, functions, plugins
from eigenfail.errors import InvalidValue
from eigenfail.settings import convert, read_settings
from eigenfail.toml_files import read_toml
from eigenfail.values import CampaignSpec, DisturbanceModel, StopRules
from eigenfail.values.variation import read_variation
from eigenfail.wire.http import refuse_unknown_fields

LIKE = "Name a TOML file with the fields of a campaign, as in examples/."

PLUGIN_FIELDS = {
    "method": (plugins.METHODS, "settings", "Settings"),
    "scenario": (plugins.SCENARIOS, "scenario_parameters", "Parameters"),
    "planner": (plugins.PLANNERS, "planner_settings", "Settings"),
    "simulator": (plugins.SIMULATORS, None, None),
}
READERS: dict[str, Callable[..., Any]] = {"Settings": read_settings, "Parameters": read_variation}
TABLES: dict[str, type[msgspec.Struct]] = {"disturbance": DisturbanceModel, "stop": StopRules}
Value = TypeVar("Value")
NONE_GIVEN: Mapping[str, float | None] = {}


def read_spec(
    file: Path, stop: Mapping[str, float | None] = NONE_GIVEN, **instead: int | str | None
) -> CampaignSpec:
    """The campaign that a file describes; its name is the file's unless it has one.

    Args:
        file: TOML with the fields of a CampaignSpec.
        stop: stop rules that take the place of the file's of the same name, where not None.
        instead: values that take the place of the file's, where not None.

    Raises:
        UnknownName: a field that campaigns do not have.
        InvalidValue: not a readable TOML file, or a value outside its bounds.
    """
    table = read_toml(file, LIKE)
    fields = {"name": file.stem, **table, **given(instead)}
    if given(stop):
        fields["stop"] = {**as_table(fields.get("stop", {}), file), **given(stop)}
    for name, kind in TABLES.items():
        if isinstance(fields.get(name), dict):
            refuse_unknown_fields(fields[name], kind, f"{file.name}: {name}")
            convert(fields[name], kind, f"{file.name}: {name}")
    return read_settings(CampaignSpec, fields, file.name)


def given(values: Mapping[str, Value | None]) -> dict[str, Value]:
    """Those of the values that there are."""
    return {name: value for name, value in values.items() if value is not None}


def as_table(stop: Any, file: Path) -> dict[str, Any]:
    """The file's stop rules.

    Raises:
        InvalidValue: they are not a table.
    """
    if not isinstance(stop, dict):
        raise InvalidValue(f"{file.name}: stop", "is not a table.", "Write it as [stop].")
    return stop


def check_plugins(spec: CampaignSpec) -> None:
    """Hold the spec against the plug-ins of this machine: for a service started here.

    Raises:
        UnknownName: a plug-in, setting or parameter that is not there.
        InvalidValue: a setting outside its bounds, or a function that may not be run here.
    """
    fields = PLUGIN_FIELDS
    if spec.simulator == functions.SIMULATOR:
        functions.check(spec)
        functions.refuse_unlisted(spec.planner)
        functions.require_module(spec.planner)
        fields = {"method": PLUGIN_FIELDS["method"]}
    if spec.simulator == bridges.SIMULATOR:
        bridges.check(spec)
        fields = {"method": PLUGIN_FIELDS["method"]}
    for field, (group, settings_field, kind) in fields.items():
        plugin = plugins.load(group, getattr(spec, field))
        if settings_field and kind:
            READERS[kind](getattr(plugin, kind), getattr(spec, settings_field), settings_field)
