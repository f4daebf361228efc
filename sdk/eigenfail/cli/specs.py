"""Campaigns from TOML files, refused before anything is started."""

import tomllib
from pathlib import Path
from typing import Any

from eigenfail import plugins
from eigenfail.errors import InvalidValue
from eigenfail.settings import convert, read_settings
from eigenfail.values import CampaignSpec, DisturbanceModel
from eigenfail.wire.http import refuse_unknown_fields

LIKE = "Name a TOML file with the fields of a campaign, as in examples/."

PLUGIN_FIELDS = {
    "method": (plugins.METHODS, "settings", "Settings"),
    "scenario": (plugins.SCENARIOS, "scenario_parameters", "Parameters"),
    "planner": (plugins.PLANNERS, "planner_settings", "Settings"),
    "simulator": (plugins.SIMULATORS, None, None),
}


def read_spec(file: Path, **instead: int | None) -> CampaignSpec:
    """The campaign that a file describes; its name is the file's unless it has one.

    Args:
        file: TOML with the fields of a CampaignSpec.
        instead: values that take the place of the file's, where not None.

    Raises:
        UnknownName: a field that campaigns do not have.
        InvalidValue: not a readable TOML file, or a value outside its bounds.
    """
    table = read_toml(file)
    given = {name: value for name, value in instead.items() if value is not None}
    fields = {"name": file.stem, **table, **given}
    disturbance = fields.get("disturbance")
    if isinstance(disturbance, dict):
        where = f"{file.name}: disturbance"
        refuse_unknown_fields(disturbance, DisturbanceModel, where)
        convert(disturbance, DisturbanceModel, where)
    return read_settings(CampaignSpec, fields, file.name)


def read_toml(file: Path) -> dict[str, Any]:
    """The table in a file.

    Raises:
        InvalidValue: it cannot be read, or is not TOML.
    """
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise InvalidValue(str(file), f"cannot be read: {error.strerror}.", LIKE) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InvalidValue(str(file), f"is not TOML: {error}.", LIKE) from error


def check_plugins(spec: CampaignSpec) -> None:
    """Hold the spec against the plug-ins of this machine: for a service started here.

    Raises:
        UnknownName: a plug-in, setting or parameter that is not there.
        InvalidValue: a setting outside its bounds.
    """
    for field, (group, settings_field, kind) in PLUGIN_FIELDS.items():
        plugin = plugins.load(group, getattr(spec, field))
        if settings_field and kind:
            read_settings(getattr(plugin, kind), getattr(spec, settings_field), settings_field)
