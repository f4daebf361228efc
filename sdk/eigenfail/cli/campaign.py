"""`eigenfail campaign`: create, follow and steer campaigns."""

from itertools import islice
from typing import Annotated

import typer

from eigenfail.cli.costs import cost
from eigenfail.cli.course_tables import campaign_page, course_table
from eigenfail.cli.minimal_words import shrunk, with_words
from eigenfail.cli.options import (
    DEFAULT_URL,
    AsJson,
    CampaignId,
    Episodes,
    Gate,
    Limit,
    Seed,
    SpecFile,
    Url,
)
from eigenfail.cli.output import show
from eigenfail.cli.progress import follow
from eigenfail.cli.regions import region
from eigenfail.cli.safety import safety
from eigenfail.cli.signals import interruptible
from eigenfail.cli.specs import read_spec
from eigenfail.cli.surroundings import client_at
from eigenfail.cli.tables import campaign_facts, campaign_table, result_table
from eigenfail.cli.verdict import judge
from eigenfail.values import Campaign, CampaignState

app = typer.Typer(
    add_completion=False, no_args_is_help=True, help="Create, follow and steer campaigns."
)

app.command()(safety)
app.command()(region)
app.command()(cost)

State = Annotated[CampaignState | None, typer.Option(help="Only campaigns in this state.")]


@app.command()
def create(
    context: typer.Context,
    file: SpecFile,
    url: Url = DEFAULT_URL,
    episodes: Episodes = None,
    seed: Seed = None,
    as_json: AsJson = False,
) -> None:
    """Launch the campaign that a TOML file describes, and print its id."""
    spec = read_spec(file, episodes=episodes, seed=seed)
    with client_at(context, url) as client:
        created = client.campaigns.create(spec)
    show_one(created, as_json)


@app.command("list")
def list_campaigns(
    context: typer.Context,
    url: Url = DEFAULT_URL,
    state: State = None,
    limit: Limit = 20,
    as_json: AsJson = False,
) -> None:
    """List campaigns, newest first."""
    with client_at(context, url) as client:
        found = list(islice(client.campaigns.list(state), limit))
    show(found, as_json, lambda: campaign_table(found))


@app.command("show")
def show_campaign(
    context: typer.Context,
    campaign: CampaignId,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Show a campaign as it stands: its settings, and its episodes by conflict class."""
    with client_at(context, url) as client:
        found = client.campaigns.get(campaign)
        summary = client.campaigns.summary(campaign)
        words = shrunk(client, found)
    show(found, as_json, lambda: with_words(campaign_page(found, summary), words))


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


@app.command()
def pause(
    context: typer.Context,
    campaign: CampaignId,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Pause a campaign; what is running is finished first."""
    with client_at(context, url) as client:
        show_one(client.campaigns.pause(campaign), as_json)


@app.command()
def resume(
    context: typer.Context,
    campaign: CampaignId,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Go on with a paused campaign, where it stopped."""
    with client_at(context, url) as client:
        show_one(client.campaigns.resume(campaign), as_json)


@app.command()
def cancel(
    context: typer.Context,
    campaign: CampaignId,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """End a campaign for good; its finished episodes are kept."""
    with client_at(context, url) as client:
        show_one(client.campaigns.cancel(campaign), as_json)


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


def show_one(campaign: Campaign, as_json: bool) -> None:
    """Print one campaign."""
    show(campaign, as_json, lambda: campaign_facts(campaign))
