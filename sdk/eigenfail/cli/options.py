"""Options and arguments that several commands share, and the names of values in help.

A whole number is N, another number NUMBER, and a text, file or folder has the name of what it is. A
command names a value itself where only that command has it; all others are named here.
"""

from enum import EnumType
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import typer

from eigenfail.bridges import ADDRESS_OPTION, ADDRESS_VARIABLE
from eigenfail.cli import completion
from eigenfail.errors import InvalidValue
from eigenfail.suites import LEAST_SEEDS, MOST_MEMBERS
from eigenfail.values.campaign_spec import Priority

Url = Annotated[
    str,
    typer.Option(
        "--url",
        envvar="EIGENFAIL_URL",
        show_default="that of the data folder's service, or http://127.0.0.1:8440",
        help="Address of the service.",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]
Data = Annotated[
    Path,
    typer.Option("--data", envvar="EIGENFAIL_DATA", help="Folder of the database and the logs."),
]
CampaignId = Annotated[
    int,
    typer.Argument(
        metavar="CAMPAIGN",
        min=1,
        help="Id of a campaign.",
        autocompletion=completion.complete_campaigns,
    ),
]
Project = Annotated[str | None, typer.Option(help="Limit to this project.")]
EpisodeId = Annotated[
    str, typer.Argument(metavar="CAMPAIGN/INDEX", help="An episode, such as 3/17.")
]
SpecFile = Annotated[
    Path,
    typer.Argument(metavar="FILE.toml", help="The campaign: fields of a CampaignSpec, as TOML."),
]
Episodes = Annotated[
    int | None,
    typer.Option("--episodes", min=1, help="Budget, replacing that of the file. [episodes]"),
]
Seed = Annotated[
    int | None, typer.Option("--seed", min=0, help="Seed, replacing that of the file.")
]
Changed = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="FIELD=VALUE",
        help="Field to change, such as settings.alpha=100; repeatable.",
    ),
]
Seeds = Annotated[
    int | None,
    typer.Option(
        "--seeds",
        min=LEAST_SEEDS,
        max=MOST_MEMBERS,
        help="Run this many campaigns as one suite, with the seed and those that follow it, and "
        "print mean and spread over seeds.",
    ),
]
Urgency = Annotated[
    Priority | None,
    typer.Option("--priority", help="Priority, replacing that of the file."),
]
StopFailures = Annotated[
    int | None,
    typer.Option("--stop-failures", min=1, help="Stop at this number of failures. [stop.failures]"),
]
StopHalfWidth = Annotated[
    float | None,
    typer.Option(
        "--stop-half-width",
        help="Stop when half the width of the 95 % confidence sequence of the failure rate "
        "is at most this. [stop.half_width]",
    ),
]
StopCv = Annotated[
    float | None,
    typer.Option(
        "--stop-cv",
        help="Stop when the coefficient of variation of the estimated failure probability, or of "
        "its lower bound, is at most this. [stop.cv]",
    ),
]
StopWall = Annotated[
    float | None,
    typer.Option("--stop-wall-s", help="Stop after this running time. [stop.wall_s, s]"),
]
StopCost = Annotated[
    float | None, typer.Option("--stop-cost-usd", help="Stop at this cost. [stop.cost_usd, USD]")
]
Gate = Annotated[
    bool, typer.Option("--gate", help="Exit with 1 if failures were found, for pipelines.")
]
Watched = Annotated[
    bool, typer.Option("--watch", help="Refresh until no campaign shown is running.")
]
Limit = Annotated[int, typer.Option(min=1, help="Maximum number of rows.")]
Workers = Annotated[
    int,
    typer.Option(
        min=0, help="Number of workers of the service that this command starts; 0: one per core."
    ),
]
Database = Annotated[
    str | None,
    typer.Option(
        "--database",
        envvar="EIGENFAIL_DATABASE",
        help="SQLAlchemy URL, replacing the database of the data folder.",
    ),
]
Replay = Annotated[
    int, typer.Option("--replay", min=0, help="Number of stored episodes to rerun on this machine.")
]
Bridge = Annotated[
    str | None,
    typer.Option(
        ADDRESS_OPTION,
        envvar=ADDRESS_VARIABLE,
        metavar="ADDRESS",
        help="Address of the bridge for campaigns with simulator 'bridge'.",
    ),
]


def parse_episode_id(text: str) -> tuple[int, int]:
    """Campaign and index of an episode written as CAMPAIGN/INDEX.

    Raises:
        InvalidValue: it is not written like that.
    """
    campaign, slash, index = text.partition("/")
    if not (slash and campaign.isdecimal() and index.isdecimal()):
        raise InvalidValue("episode", f"'{text}' is not of the form CAMPAIGN/INDEX, such as 3/17.")
    return int(campaign), int(index)


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
    """Return the name of a parameter's value; None if its choices are listed in its place."""
    kind = parameter.type_descriptor.annotation
    # The choices say more than a name would.
    if isinstance(kind, EnumType):
        return None
    if parameter.param_type_name == "argument":
        name: str = parameter.name.upper()
        return name
    if kind in {int, float, bool}:
        return _KINDS[kind]
    return next((_OPTIONS[each] for each in parameter.opts if each in _OPTIONS), _KINDS.get(kind))
