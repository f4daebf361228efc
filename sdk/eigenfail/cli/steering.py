"""`eigenfail campaign pause`, `resume`, `cancel` and `priority`."""

from collections.abc import Callable
from typing import Annotated

import typer

from eigenfail.cli.campaign_facts import campaign_facts
from eigenfail.cli.options import DEFAULT_URL, AsJson, CampaignId, Url
from eigenfail.cli.output import show
from eigenfail.cli.surroundings import client_at
from eigenfail.client.campaigns import Campaigns
from eigenfail.values import Campaign, Priority

Act = Callable[[Campaigns, int], Campaign]

ACTS: dict[str, tuple[Act, str]] = {
    "pause": (Campaigns.pause, "Pause a campaign; what is running is finished first."),
    "resume": (Campaigns.resume, "Go on with a paused campaign, where it stopped."),
    "cancel": (Campaigns.cancel, "End a campaign for good; its finished episodes are kept."),
}


def of_campaign(act: Act) -> Callable[..., None]:
    """The command that does it, and shows what has become of the campaign."""

    def command(
        context: typer.Context,
        campaign: CampaignId,
        url: Url = DEFAULT_URL,
        as_json: AsJson = False,
    ) -> None:
        with client_at(context, url) as client:
            found = act(client.campaigns, campaign)
        show(found, as_json, lambda: campaign_facts(found))

    return command


def priority(
    context: typer.Context,
    campaign: CampaignId,
    wanted: Annotated[Priority, typer.Argument(metavar="PRIORITY", help="low, normal or high.")],
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Give a campaign another share of the workers, and another place in the queue."""
    with client_at(context, url) as client:
        found = client.campaigns.prioritise(campaign, wanted)
    show(found, as_json, lambda: campaign_facts(found))


def add_steering(app: typer.Typer) -> None:
    """Add the commands."""
    for name, (act, text) in ACTS.items():
        app.command(name, help=text)(of_campaign(act))
    app.command()(priority)
