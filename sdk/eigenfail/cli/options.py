"""Options and arguments that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

from eigenfail.bridges import ADDRESS_OPTION, ADDRESS_VARIABLE
from eigenfail.cli import completion
from eigenfail.errors import InvalidValue
from eigenfail.hosting.folder import HOST
from eigenfail.values import Priority

PORT = 8440
DEFAULT_URL = f"http://{HOST}:{PORT}"
DEFAULT_DATA = Path("eigenfail-data")

Url = Annotated[str, typer.Option("--url", envvar="EIGENFAIL_URL", help="Address of the service.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]
Data = Annotated[
    Path,
    typer.Option("--data", envvar="EIGENFAIL_DATA", help="Folder of the database and the logs."),
]
CampaignId = Annotated[
    int,
    typer.Argument(
        metavar="CAMPAIGN", min=1, help="Id of a campaign.", autocompletion=completion.campaigns
    ),
]
EpisodeId = Annotated[
    str, typer.Argument(metavar="CAMPAIGN/INDEX", help="An episode, such as 3/17.")
]
SpecFile = Annotated[
    Path,
    typer.Argument(metavar="FILE.toml", help="The campaign: fields of a CampaignSpec, as TOML."),
]
Episodes = Annotated[
    int | None, typer.Option("--episodes", min=1, help="Budget, instead of the file's. [episodes]")
]
Seed = Annotated[int | None, typer.Option("--seed", min=0, help="Seed, instead of the file's.")]
Urgency = Annotated[
    Priority | None,
    typer.Option("--priority", help="Its share of the workers, instead of the file's."),
]
StopFailures = Annotated[
    int | None,
    typer.Option("--stop-failures", min=1, help="Stop at so many failures. [stop.failures]"),
]
StopHalfWidth = Annotated[
    float | None,
    typer.Option(
        "--stop-half-width",
        help="Stop when the failure rate is known to ± this (95 %). [stop.half_width]",
    ),
]
StopCv = Annotated[
    float | None,
    typer.Option(
        "--stop-cv",
        help="Stop when the failure probability's coefficient of variation is this. [stop.cv]",
    ),
]
StopWall = Annotated[
    float | None,
    typer.Option("--stop-wall-s", help="Stop after running for so many seconds. [stop.wall_s]"),
]
StopCost = Annotated[
    float | None, typer.Option("--stop-cost-usd", help="Stop at this cost. [stop.cost_usd]")
]
Gate = Annotated[
    bool, typer.Option("--gate", help="Exit with 1 if failures were found, for pipelines.")
]
Watched = Annotated[
    bool, typer.Option("--watch", help="Draw it again until no campaign in it is at work.")
]
Limit = Annotated[int, typer.Option(min=1, help="How many to list at most.")]
Workers = Annotated[int, typer.Option(min=0, help="How many workers to start; 0: one per core.")]

Bridge = Annotated[
    str | None,
    typer.Option(
        ADDRESS_OPTION,
        envvar=ADDRESS_VARIABLE,
        metavar="ADDRESS",
        help="Where workers find what campaigns with simulator 'bridge' run on.",
    ),
]


def episode_id(text: str) -> tuple[int, int]:
    """Campaign and index of an episode written as CAMPAIGN/INDEX.

    Raises:
        InvalidValue: it is not written like that.
    """
    campaign, slash, index = text.partition("/")
    if not (slash and campaign.isdecimal() and index.isdecimal()):
        raise InvalidValue("episode", f"'{text}' is not of the form CAMPAIGN/INDEX, such as 3/17.")
    return int(campaign), int(index)
