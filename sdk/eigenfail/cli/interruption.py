"""Ctrl-C during a campaign: it is paused, nothing finished is lost, and the way on is said."""

from collections.abc import Callable

import typer

from eigenfail.cli.progress import follow, nothing_wrong
from eigenfail.client import Client
from eigenfail.errors import IllegalTransition, ServiceError
from eigenfail.values import FINAL_STATES, Campaign

PAUSE_WITHIN_S = 15.0
INTERRUPTED = 130


def follow_or_pause(
    client: Client, campaign: int, check: Callable[[], None] = nothing_wrong, again: str = ""
) -> Campaign:
    """Follow a campaign to its end; on Ctrl-C pause it, say how to go on, and exit with 130.

    Args:
        client: of the service that runs it.
        campaign: its id.
        check: raises if the service is in trouble.
        again: the command that starts the service again, if it ends with this command.
    """
    try:
        return follow(client, campaign, check)
    except KeyboardInterrupt:
        seen = pause(client, campaign)
        typer.echo(parting_words(seen, again), err=True)
        raise typer.Exit(INTERRUPTED) from None


def pause(client: Client, campaign: int) -> Campaign:
    """The campaign, paused unless it ended first; it may still be pausing after a while."""
    try:
        client.campaigns.pause(campaign)
        return client.campaigns.wait(campaign, timeout_s=PAUSE_WITHIN_S)
    except (IllegalTransition, ServiceError):
        return client.campaigns.get(campaign)


def parting_words(campaign: Campaign, again: str) -> str:
    """How far the campaign came, and how to go on."""
    counts = campaign.counts
    done = f"{counts.completed + counts.failed} of {counts.planned} episodes"
    came = f"Campaign {campaign.id} is {campaign.state} after {done}."
    if campaign.state in FINAL_STATES:
        return came
    first = f"start the service with '{again}', then " if again else ""
    return f"{came} To go on: {first}eigenfail campaign resume {campaign.id}"
