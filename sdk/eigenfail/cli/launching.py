"""`eigenfail campaign create`, `check` and `clone`: campaigns before and as they are launched."""

from collections.abc import Callable
from typing import Annotated

import typer

from eigenfail.cli.campaign_facts import campaign_facts
from eigenfail.cli.drafts import checked, read_values
from eigenfail.cli.options import (
    DEFAULT_URL,
    AsJson,
    CampaignId,
    Episodes,
    Seed,
    SpecFile,
    Urgency,
    Url,
)
from eigenfail.cli.output import show
from eigenfail.cli.specs import read_spec
from eigenfail.cli.surroundings import client_at
from eigenfail.client import Client
from eigenfail.values import Campaign, CampaignSpec
from eigenfail.wire.problems import error_of

Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print the id of what is launched, and no more.")
]

Act = Callable[[Client, CampaignSpec, bool, bool], None]
"""What is done with a file's campaign, quietly or not, and as JSON or not."""


def of_file(act: Act) -> Callable[..., None]:
    """The command that does it with the campaign of a file."""

    def command(
        context: typer.Context,
        file: SpecFile,
        url: Url = DEFAULT_URL,
        episodes: Episodes = None,
        seed: Seed = None,
        priority: Urgency = None,
        quiet: Quiet = False,
        as_json: AsJson = False,
    ) -> None:
        spec = read_spec(file, episodes=episodes, seed=seed, priority=priority)
        with client_at(context, url) as client:
            act(client, spec, quiet, as_json)

    return command


def create(client: Client, spec: CampaignSpec, quiet: bool, as_json: bool) -> None:
    """Launch the campaign that a TOML file describes, and show it."""
    show_launched(client.campaigns.create(spec), quiet, as_json)


def check(client: Client, spec: CampaignSpec, quiet: bool, as_json: bool) -> None:
    """Say what the campaign that a TOML file describes would be, and launch nothing.

    Exits with 2 if it cannot be launched.
    """
    found = client.campaigns.check(spec)
    if not quiet:
        show(found, as_json, lambda: checked(found))
    if found.problems:
        raise typer.Exit(error_of(found.problems[0]).exit_code)


def clone(
    context: typer.Context,
    campaign: CampaignId,
    url: Url = DEFAULT_URL,
    name: Annotated[str | None, typer.Option(help="Name of the new one.")] = None,
    episodes: Annotated[int | None, typer.Option(min=1, help="Budget of the new one.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of the new one.")] = None,
    values: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="FIELD=VALUE", help="Such as settings.alpha=100; again for more."
        ),
    ] = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Launch a campaign like an earlier one, with other values, and show it."""
    given = {"name": name, "episodes": episodes, "seed": seed}
    changes = {field: value for field, value in given.items() if value is not None}
    with client_at(context, url) as client:
        created = client.campaigns.clone(campaign, **changes, **read_values(values or []))
    show_launched(created, quiet, as_json)


def show_launched(campaign: Campaign, quiet: bool, as_json: bool) -> None:
    """Print a campaign that was just launched, or its id alone, which is JSON, too."""
    if quiet:
        typer.echo(campaign.id)
        return
    show(campaign, as_json, lambda: campaign_facts(campaign))


def add_launching(app: typer.Typer) -> None:
    """Add the commands."""
    for act in (create, check):
        app.command(act.__name__, help=act.__doc__)(of_file(act))
    app.command()(clone)
