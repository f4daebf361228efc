"""`eigenfail compare`: two campaigns, or several seeds of each, side by side."""

import re
from typing import Annotated

import typer

from eigenfail.cli.answers import prints_answer
from eigenfail.cli.render import CommandResult
from eigenfail.client import Client
from eigenfail.errors import InvalidValue
from eigenfail.presentation.campaigns import describe_comparison
from eigenfail.progress import announce

app = typer.Typer(add_completion=False)

IDS = re.compile(r"[1-9]\d*(,[1-9]\d*)*")

SideIds = Annotated[
    str, typer.Argument(help="Id of a campaign, or of several seeds of it, such as 1,2,3.")
]


@app.command()
@prints_answer()
def compare(client: Client, a: SideIds, b: SideIds) -> CommandResult:
    """Compare two campaigns, or several seeds of each.

    Failure rates and their difference, with 95 % intervals where both drew noise from p(x); cost
    per failure and log p per step; where both saw the same noise (Monte Carlo or replay from the
    same seed) McNemar's exact test on pairs of episodes; over seeds, if there are enough of
    them, the Vargha-Delaney effect size of the failure rates.
    """
    # Read first: a mistyped id costs no comparison.
    sides = _parse_campaign_ids("A", a), _parse_campaign_ids("B", b)
    with announce("Comparing the campaigns"):
        found = client.campaigns.compare(*sides)
    return CommandResult(found, *describe_comparison(found))


def _parse_campaign_ids(side: str, text: str) -> tuple[int, ...]:
    """The ids of one side.

    Raises:
        InvalidValue: the text is not a comma-separated list of numbers.
    """
    if not IDS.fullmatch(text):
        raise InvalidValue(side, f"'{text}' is not of the form 1 or 1,2,3.", "Give campaign ids.")
    return tuple(map(int, text.split(",")))
