"""Assess failures per hour and per 10^6 km of a planner, against a target rate."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer
from msgspec.structs import replace
from typer.core import TyperGroup

from eigenfail.cli.connection import connect_to
from eigenfail.cli.options import AsJson, Url
from eigenfail.cli.render import show
from eigenfail.client import Client
from eigenfail.hosting.folder import DEFAULT_URL
from eigenfail.presentation.tables import Block
from eigenfail.progress import announce
from eigenfail_assurance.risk.assessment import RiskAssessment, RiskVerdict
from eigenfail_assurance.risk.client import assess_risk
from eigenfail_assurance.risk.question import EPISODES, RiskQuestion, read_risk_file
from eigenfail_assurance.risk.sentences import describe_allocation, describe_assessment, list_limits

ASSESS = "assess"

EXIT_CODES = {RiskVerdict.MET: 0, RiskVerdict.NOT_MET: 1, RiskVerdict.UNDECIDED: 3}

NEXT = "See where the next episodes help most: eigenfail risk next FILE.toml"


class RiskCommands(TyperGroup):
    """`eigenfail risk`, which assesses the risk of a file if no other command is named."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put the command in front of a file."""
        if args and args[0] not in (*self.commands, *ctx.help_option_names):
            args = [ASSESS, *args]
        return super().parse_args(ctx, args)


app = typer.Typer(
    cls=RiskCommands,
    add_completion=False,
    no_args_is_help=True,
    help="Assess failures per hour and per 10^6 km of a planner, against a target rate.\n\n"
    "`eigenfail risk FILE.toml` is short for `eigenfail risk assess FILE.toml`.",
)

RiskFile = Annotated[
    Path,
    typer.Argument(
        metavar="FILE.toml", help="Exposure, scenarios with their campaigns, and the target."
    ),
]
Episodes = Annotated[
    int, typer.Option("--episodes", min=1, help="Size of the next budget. [episodes]")
]


@app.command(ASSESS)
def assess(
    context: typer.Context, file: RiskFile, url: Url = DEFAULT_URL, as_json: AsJson = False
) -> None:
    """Multiply how often scenarios are met by how often they end in a failure.

    The probabilities are those of campaigns of the service that may state one: monte_carlo, subset,
    mixture or splitting. Exits with 0 if the target is met with 95 % confidence, with 1 if it is
    not met, and with 3 if it is undecided. An error of the service exits with 3 as well, with a
    message on standard error and no answer on standard output.
    """
    with connect_to(context, url) as client:
        found = _assess(client, read_risk_file(file))
    show(found, as_json, *_list_blocks(found))
    raise typer.Exit(EXIT_CODES[found.verdict])


@app.command("next")
def allocate(
    context: typer.Context,
    file: RiskFile,
    episodes: Episodes = EPISODES,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Find where the next episodes take most off the error of the total.

    Episodes are divided by Neyman's allocation, those that were run counted in.
    """
    question = replace(read_risk_file(file), episodes=episodes)
    with connect_to(context, url) as client:
        found = _assess(client, question)
    show(found.next, as_json, *describe_allocation(found.next), *list_limits(found))


def _assess(client: Client, question: RiskQuestion) -> RiskAssessment:
    with announce("Assessing the risk"):
        return assess_risk(client, question)


def _list_blocks(found: RiskAssessment) -> Iterator[Block]:
    """Yield the answer, with what to do next where it is undecided."""
    yield from describe_assessment(found)
    if found.verdict is RiskVerdict.UNDECIDED:
        yield NEXT
