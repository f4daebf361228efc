"""`eigenfail campaign`: create, follow and steer campaigns."""

from typing import Annotated

import typer

from eigenfail.cli import completion
from eigenfail.cli.costs import cost
from eigenfail.cli.course_tables import campaign_page, course_table
from eigenfail.cli.crew import workers
from eigenfail.cli.lacking import lacking
from eigenfail.cli.launching import add_launching
from eigenfail.cli.minimal_words import shrunk, with_words
from eigenfail.cli.options import (
    DEFAULT_URL,
    AsJson,
    CampaignId,
    Gate,
    Limit,
    Url,
    Watched,
)
from eigenfail.cli.output import show
from eigenfail.cli.progress import follow
from eigenfail.cli.regions import region
from eigenfail.cli.safety import safety
from eigenfail.cli.steering import add_steering
from eigenfail.cli.surroundings import client_at
from eigenfail.cli.tables import campaign_table, result_table
from eigenfail.cli.verdict import judge
from eigenfail.cli.watching import View
from eigenfail.hosting.signals import interruptible
from eigenfail.values import CampaignState

app = typer.Typer(
    add_completion=False, no_args_is_help=True, help="Create, follow and steer campaigns."
)

State = Annotated[CampaignState | None, typer.Option(help="Only campaigns in this state.")]
Method = Annotated[
    str | None,
    typer.Option(help="Only campaigns of this method.", autocompletion=completion.methods),
]
Search = Annotated[
    str | None,
    typer.Option(help="Only campaigns whose name contains this, in small or large letters."),
]


add_launching(app)


@app.command("list")
def list_campaigns(
    context: typer.Context,
    url: Url = DEFAULT_URL,
    state: State = None,
    method: Method = None,
    search: Search = None,
    limit: Limit = 20,
    watched: Watched = False,
    as_json: AsJson = False,
) -> None:
    """List campaigns, newest first."""
    with interruptible(), client_at(context, url) as client:
        page = View(
            look=lambda: client.campaigns.list(state, None, method, search).first(limit),
            campaigns=lambda seen: seen,
            told=lambda seen: seen,
            draw=campaign_table,
        )
        page.watch(as_json) if watched else page.show(as_json)


@app.command("show")
def show_campaign(
    context: typer.Context,
    campaign: CampaignId,
    url: Url = DEFAULT_URL,
    watched: Watched = False,
    as_json: AsJson = False,
) -> None:
    """Show a campaign as it stands: its settings, and its episodes by conflict class."""
    with interruptible(), client_at(context, url) as client:
        page = View(
            look=lambda: (client.campaigns.get(campaign), client.campaigns.summary(campaign)),
            campaigns=lambda seen: seen[:1],
            told=lambda seen: seen[0],
            draw=lambda seen: with_words(
                campaign_page(*seen), (*lacking(client, seen[0]), *shrunk(client, seen[0]))
            ),
        )
        page.watch(as_json) if watched else page.show(as_json)


@app.command()
def course(
    context: typer.Context,
    campaign: CampaignId,
    per: Annotated[int | None, typer.Option(min=1, help="Episodes of a block.")] = None,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Show how failure rate, likelihood and robustness moved: the learning curve."""
    with client_at(context, url) as client:
        found = client.campaigns.course(campaign, per)
    show(found, as_json, lambda: course_table(found))


add_steering(app)


@app.command()
def digest(
    context: typer.Context,
    campaign: CampaignId,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Print the digest over all results: the same campaign gives the same digest anywhere."""
    with client_at(context, url) as client:
        found = client.campaigns.digest(campaign)
    show({"campaign": campaign, "digest": found}, as_json, lambda: found)


@app.command()
def watch(
    context: typer.Context,
    campaign: CampaignId,
    url: Url = DEFAULT_URL,
    gate: Gate = False,
    as_json: AsJson = False,
) -> None:
    """Follow a campaign to its end, and print its results; Ctrl-C leaves it running."""
    with interruptible(), client_at(context, url) as client:
        ended = follow(client, campaign)
        summary = client.campaigns.summary(campaign)
        words = shrunk(client, ended)
    show(summary, as_json, lambda: with_words(result_table([summary]), words))
    judge(ended, gate)


for page in (safety, region, cost, workers):
    app.command()(page)
