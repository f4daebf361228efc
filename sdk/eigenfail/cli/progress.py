"""A campaign as it goes, until its end."""

from collections.abc import Callable

import typer

from eigenfail.cli.lacking import Lookout
from eigenfail.client import Client
from eigenfail.progress import headline, reporter
from eigenfail.values import Campaign, CampaignState


def nothing_wrong() -> None:
    """The check of a service that somebody else looks after."""


def follow(client: Client, campaign: int, check: Callable[[], None] = nothing_wrong) -> Campaign:
    """Show the campaign's progress until it has ended or is paused.

    Args:
        client: of the service that runs it.
        campaign: its id.
        check: raises if the service is in trouble.
    """
    lookout = Lookout(client)
    with reporter() as report:

        def look(seen: Campaign) -> None:
            check()
            report(seen)
            lookout(seen)

        ended = client.campaigns.wait(campaign, look)
    if ended.state is CampaignState.DONE:
        typer.echo(f"{headline(ended)}: {ended.stopped_because}", err=True)
    return ended
