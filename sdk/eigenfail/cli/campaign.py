"""`eigenfail campaign`: create, check, clone, list, show, follow and steer campaigns."""

from collections.abc import Callable
from typing import Annotated

import typer

from eigenfail.cli import completion, options
from eigenfail.cli.connection import connect_to
from eigenfail.cli.render import (
    TerminalView,
    describe_method_result,
    find_missing_workers,
    follow,
    judge,
    show,
)
from eigenfail.cli.specs import describe_check, parse_changes, read_spec
from eigenfail.client.campaigns import Campaigns
from eigenfail.filters import CAMPAIGN_ORDERS, NEWEST_FIRST
from eigenfail.hosting.folder import DEFAULT_URL
from eigenfail.hosting.processes import interruptible
from eigenfail.presentation.campaigns import (
    describe_campaign,
    describe_costs,
    describe_region,
    describe_safety,
    list_campaign_facts,
    tabulate_campaigns,
    tabulate_course,
    tabulate_results,
    tabulate_workers,
)
from eigenfail.presentation.terminal import render
from eigenfail.progress import announce
from eigenfail.values import Campaign, CampaignState, Priority
from eigenfail.values.safety import TAIL_LEVEL
from eigenfail.wire.http import make_error
from eigenfail.worlds import find_robustness_unit

Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print only the id of the launched campaign.")
]
QuietCheck = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print nothing; the exit code gives the result.")
]


def create(
    context: typer.Context,
    file: options.SpecFile,
    url: options.Url = DEFAULT_URL,
    episodes: options.Episodes = None,
    seed: options.Seed = None,
    priority: options.Urgency = None,
    values: options.Changed = None,
    quiet: Quiet = False,
    as_json: options.AsJson = False,
) -> None:
    """Launch the campaign that a TOML file describes, and print it."""
    spec = read_spec(file, changes=values, episodes=episodes, seed=seed, priority=priority)
    with connect_to(context, url) as client:
        _show_launched(client.campaigns.create(spec), quiet, as_json)


def check(
    context: typer.Context,
    file: options.SpecFile,
    url: options.Url = DEFAULT_URL,
    episodes: options.Episodes = None,
    seed: options.Seed = None,
    priority: options.Urgency = None,
    values: options.Changed = None,
    quiet: QuietCheck = False,
    as_json: options.AsJson = False,
) -> None:
    """Print the full specification of the campaign in a TOML file without launching it.

    Exits with 2 if it cannot be launched.
    """
    spec = read_spec(file, changes=values, episodes=episodes, seed=seed, priority=priority)
    with connect_to(context, url) as client:
        found = client.campaigns.check(spec)
    if not quiet:
        show(found, as_json, lambda: describe_check(found))
    if found.problems:
        raise typer.Exit(make_error(found.problems[0]).exit_code)


def clone(
    context: typer.Context,
    campaign: options.CampaignId,
    url: options.Url = DEFAULT_URL,
    name: Annotated[str | None, typer.Option(help="Name of the new campaign.")] = None,
    episodes: Annotated[
        int | None, typer.Option(min=1, help="Budget of the new campaign. [episodes]")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of the new campaign.")] = None,
    values: options.Changed = None,
    quiet: Quiet = False,
    as_json: options.AsJson = False,
) -> None:
    """Launch a copy of an earlier campaign with changed values, and print it."""
    given = {"name": name, "episodes": episodes, "seed": seed}
    named = {field: value for field, value in given.items() if value is not None}
    changes = {**named, **parse_changes(values or [])}
    with connect_to(context, url) as client:
        created = client.campaigns.clone(campaign, **changes)
    _show_launched(created, quiet, as_json)


def _show_launched(campaign: Campaign, quiet: bool, as_json: bool) -> None:
    """Print a campaign that was just launched, or its id alone, which is JSON, too."""
    if quiet:
        typer.echo(campaign.id)
        return
    show(campaign, as_json, lambda: render(list_campaign_facts(campaign)))


def _add_launching(app: typer.Typer) -> None:
    """Add the commands."""
    for command in (create, check, clone):
        app.command()(command)


Act = Callable[[Campaigns, int], Campaign]

ACTS: dict[str, tuple[Act, str]] = {
    "pause": (Campaigns.pause, "Pause a campaign; its running episodes are finished and kept."),
    "resume": (Campaigns.resume, "Resume a paused campaign."),
    "cancel": (Campaigns.cancel, "Cancel a campaign; its finished episodes are kept."),
    "archive": (
        Campaigns.archive,
        "Archive a campaign that has ended: lists omit it, and nothing of it is deleted.",
    ),
    "restore": (Campaigns.restore, "List an archived campaign again."),
}


def _make_command(act: Act) -> Callable[..., None]:
    """The command that does it, and shows what has become of the campaign."""

    def command(
        context: typer.Context,
        campaign: options.CampaignId,
        url: options.Url = DEFAULT_URL,
        as_json: options.AsJson = False,
    ) -> None:
        with connect_to(context, url) as client:
            found = act(client.campaigns, campaign)
        show(found, as_json, lambda: render(list_campaign_facts(found)))

    return command


def priority(
    context: typer.Context,
    campaign: options.CampaignId,
    wanted: Annotated[Priority, typer.Argument(metavar="PRIORITY", help="low, normal or high.")],
    url: options.Url = DEFAULT_URL,
    as_json: options.AsJson = False,
) -> None:
    """Change the priority of a campaign: its share of the workers and its place in the queue."""
    with connect_to(context, url) as client:
        found = client.campaigns.prioritise(campaign, wanted)
    show(found, as_json, lambda: render(list_campaign_facts(found)))


def _add_steering(app: typer.Typer) -> None:
    """Add the commands."""
    for name, (act, text) in ACTS.items():
        app.command(name, help=text)(_make_command(act))
    app.command()(priority)


app = typer.Typer(
    add_completion=False, no_args_is_help=True, help="Create, monitor and control campaigns."
)

State = Annotated[CampaignState | None, typer.Option(help="Only campaigns in this state.")]
Method = Annotated[
    str | None,
    typer.Option(help="Only campaigns of this method.", autocompletion=completion.complete_methods),
]
Search = Annotated[
    str | None,
    typer.Option(help="Only campaigns whose name contains this text, ignoring case."),
]
Project = Annotated[str | None, typer.Option(help="Only campaigns of this project.")]
Tag = Annotated[str | None, typer.Option(help="Only campaigns with this tag.")]
PlannerVersion = Annotated[
    str | None, typer.Option(help="Only campaigns of this version of a planner.")
]
Sort = Annotated[
    str,
    typer.Option(
        metavar="COLUMN",
        help=f"Order: {', '.join(CAMPAIGN_ORDERS)}; with a minus, the largest first.",
    ),
]
Archived = Annotated[bool, typer.Option("--archived", help="List archived campaigns, too.")]
Level = Annotated[float, typer.Option(help="Level of VaR and CVaR of severity.")]
Ids = Annotated[
    list[int], typer.Argument(metavar="CAMPAIGN...", min=1, help="One campaign, or several.")
]
VariedIds = Annotated[
    list[int],
    typer.Argument(
        metavar="CAMPAIGN...", min=1, help="A campaign with varying parameters, or those of a grid."
    ),
]

_add_launching(app)


@app.command("list")
def list_campaigns(
    context: typer.Context,
    url: options.Url = DEFAULT_URL,
    state: State = None,
    method: Method = None,
    search: Search = None,
    project: Project = None,
    tag: Tag = None,
    planner_version: PlannerVersion = None,
    sort: Sort = str(NEWEST_FIRST),
    archived: Archived = False,
    limit: options.Limit = 20,
    watched: options.Watched = False,
    as_json: options.AsJson = False,
) -> None:
    """List campaigns, by default newest first."""
    with interruptible(), connect_to(context, url) as client:
        found = client.campaigns.list(
            state,
            method=method,
            search=search,
            sort=sort,
            project=project,
            tag=tag,
            planner_version=planner_version,
            archived=archived,
        )
        page = TerminalView(
            look=lambda: found.first(limit),
            campaigns=lambda seen: seen,
            to_data=lambda seen: seen,
            draw=lambda seen: render(tabulate_campaigns(seen)),
        )
        page.watch(as_json) if watched else page.show(as_json)


@app.command("show")
def show_campaign(
    context: typer.Context,
    campaign: options.CampaignId,
    url: options.Url = DEFAULT_URL,
    watched: options.Watched = False,
    as_json: options.AsJson = False,
) -> None:
    """Show the settings, progress and results of a campaign."""
    with interruptible(), connect_to(context, url) as client:
        page = TerminalView(
            look=lambda: (client.campaigns.get(campaign), client.campaigns.summary(campaign)),
            campaigns=lambda seen: seen[:1],
            to_data=lambda seen: seen[0],
            draw=lambda seen: render(
                *describe_campaign(*seen),
                *find_missing_workers(client, seen[0]),
                *describe_method_result(client, seen[0]),
            ),
        )
        page.watch(as_json) if watched else page.show(as_json)


@app.command()
def course(
    context: typer.Context,
    campaign: options.CampaignId,
    per: Annotated[int | None, typer.Option(min=1, help="Number of episodes in a block.")] = None,
    url: options.Url = DEFAULT_URL,
    as_json: options.AsJson = False,
) -> None:
    """Show how failure rate, likelihood and robustness moved: the learning curve."""
    with connect_to(context, url) as client, announce("Reading the episodes"):
        found = client.campaigns.course(campaign, per)
        unit = find_robustness_unit(client.campaigns.get(campaign).spec)
    show(found, as_json, lambda: render(*tabulate_course(found, unit)))


_add_steering(app)


@app.command()
def digest(
    context: typer.Context,
    campaign: options.CampaignId,
    url: options.Url = DEFAULT_URL,
    as_json: options.AsJson = False,
) -> None:
    """Print the digest over all results.

    The same campaign has the same digest with the same release and kind of processor.
    """
    with connect_to(context, url) as client, announce("Reading the results"):
        found = client.campaigns.digest(campaign)
    show({"campaign": campaign, "digest": found}, as_json, lambda: found)


@app.command()
def watch(
    context: typer.Context,
    campaign: options.CampaignId,
    url: options.Url = DEFAULT_URL,
    gate: options.Gate = False,
    as_json: options.AsJson = False,
) -> None:
    """Follow a campaign to its end, and print its results; Ctrl-C leaves it running."""
    with interruptible(), connect_to(context, url) as client:
        ended = follow(client, campaign)
        summary = client.campaigns.summary(campaign)
        words = describe_method_result(client, ended)
    show(summary, as_json, lambda: render(tabulate_results([summary]), *words))
    judge(ended, gate, summary)


@app.command()
def safety(
    context: typer.Context,
    campaign: options.CampaignId,
    level: Level = TAIL_LEVEL,
    url: options.Url = DEFAULT_URL,
    as_json: options.AsJson = False,
) -> None:
    """Show collisions, near misses, MinTTC, DRAC and severity of a campaign's episodes."""
    with connect_to(context, url) as client, announce("Reading the measures"):
        found = client.campaigns.safety(campaign, level)
    show(found, as_json, lambda: render(*describe_safety(found)))


@app.command()
def region(
    context: typer.Context,
    campaigns: VariedIds,
    url: options.Url = DEFAULT_URL,
    as_json: options.AsJson = False,
) -> None:
    """Show where among the scenario's parameters the episodes of campaigns fail."""
    with connect_to(context, url) as client, announce("Searching for the failing region"):
        found = client.campaigns.region(campaigns)
    show(found, as_json, lambda: render(*describe_region(found)))


@app.command()
def cost(
    context: typer.Context,
    campaigns: Ids,
    url: options.Url = DEFAULT_URL,
    as_json: options.AsJson = False,
) -> None:
    """Show cost per failure and per failure mode, cost over time, and the use of time.

    A Monte Carlo campaign without a failure shows a lower bound of the cost per failure (95 %).
    """
    with connect_to(context, url) as client, announce("Reading the costs"):
        found = [client.campaigns.cost(campaign) for campaign in campaigns]
    show(found, as_json, lambda: render(*describe_costs(found)))


@app.command()
def workers(
    context: typer.Context,
    campaign: options.CampaignId,
    url: options.Url = DEFAULT_URL,
    as_json: options.AsJson = False,
) -> None:
    """Show the workers that ran a campaign's episodes, with their number and speed."""
    with connect_to(context, url) as client:
        found = client.campaigns.workers(campaign)
    show(found, as_json, lambda: render(tabulate_workers(found)))
