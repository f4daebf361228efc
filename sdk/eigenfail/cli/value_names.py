"""Names of the values of options and arguments in help, alike in all commands.

A whole number is N, another number NUMBER, and a text, file or folder has the name of what it is. A
command names a value itself where only that command has it; all others are named here.
"""

from enum import EnumType
from pathlib import Path
from types import MappingProxyType
from typing import Any

_OPTIONS = MappingProxyType(
    {
        "--campaign": "CAMPAIGN",
        "--channels": "CHANNELS",
        "--connect": "ADDRESS",
        "--data": "FOLDER",
        "--database": "URL",
        "--expires": "DURATION",
        "--fields": "COLUMNS",
        "--filter": "CONDITIONS",
        "--functions": "MODULES",
        "--hub-keys": "FOLDER",
        "--keep-old": "DURATION",
        "--method": "NAME",
        "--name": "NAME",
        "--pictures": "FOLDER",
        "--planner": "NAME",
        "--planner-version": "VERSION",
        "--scenario": "NAME",
        "--search": "TEXT",
        "--sort": "COLUMN",
        "--source": "SOURCE",
        "--to": "REVISION",
        "--url": "URL",
    }
)
"""Names of texts, files and folders that are no FILE, by option."""

_KINDS = MappingProxyType({int: "N", float: "NUMBER", Path: "FILE", str: "TEXT", bool: ""})
"""Names by type; a switch has no value."""


def name_values(command: Any) -> Any:
    """Return a command whose options and arguments have names of their values, with those below."""
    for parameter in command.params:
        if getattr(parameter, "metavar", None) is None and hasattr(parameter, "type_descriptor"):
            parameter.metavar = _name_value(parameter)
    for each in getattr(command, "commands", {}).values():
        name_values(each)
    return command


def _name_value(parameter: Any) -> str | None:
    """Return the name of a parameter's value; None where its choices are listed in its place."""
    kind = parameter.type_descriptor.annotation
    if isinstance(kind, EnumType):
        return None
    if parameter.param_type_name == "argument":
        name: str = parameter.name.upper()
        return name
    if kind in {int, float, bool}:
        return _KINDS[kind]
    return next((_OPTIONS[each] for each in parameter.opts if each in _OPTIONS), _KINDS.get(kind))
