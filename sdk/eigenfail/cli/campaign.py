"""`eigenfail campaign`: create, check, clone, list, show, follow and steer campaigns."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated, NamedTuple

import typer

from eigenfail import plugins
from eigenfail.cli import completion, options, render
from eigenfail.cli.answers import prints_answer
from eigenfail.cli.connection import connect_to
from eigenfail.cli.specs import describe_check, parse_changes, read_spec
from eigenfail.client import Client
from eigenfail.client.campaigns import Campaigns
from eigenfail.errors import EigenfailError
from eigenfail.filters import CAMPAIGN_ORDERS, NEWEST_FIRST
from eigenfail.hosting.folder import DEFAULT_URL
from eigenfail.hosting.processes import interruptible
from eigenfail.presentation import campaigns as presentation
from eigenfail.values.campaign import Campaign, CampaignState
from eigenfail.values.campaign_spec import CampaignSpec, Priority
from eigenfail.values.safety import TAIL_LEVEL
from eigenfail.values.summary import Summary
from eigenfail.wire.http import make_error
from eigenfail.worlds import find_robustness_unit

Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print only the id of the launched campaign.")
]
QuietCheck = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print nothing; the exit code gives the result.")
]


app = typer.Typer(
    add_completion=False, no_args_is_help=True, help="Create, monitor and control campaigns."
)


class SpecRequest(NamedTuple):
    """The campaign that a file describes, and a client of the service that is asked about it."""

    spec: CampaignSpec
    client: Client


@contextmanager
def open_with_spec(
    context: typer.Context,
    file: options.SpecFile,
    episodes: options.Episodes = None,
    seed: options.Seed = None,
    priority: options.Urgency = None,
    values: options.Changed = None,
    url: options.Url = DEFAULT_URL,
) -> Iterator[SpecRequest]:
    """Read the campaign of a file, then open the service."""
    # The file comes first: its errors are the user's to mend, whether a service runs or not.
    spec = read_spec(file, changes=values, episodes=episodes, seed=seed, priority=priority)
    with connect_to(context, url) as client:
        yield SpecRequest(spec, client)


@app.command()
@prints_answer(opened_by=open_with_spec)
def create(asked: SpecRequest, quiet: Quiet = False) -> render.CommandResult:
    """Launch the campaign that a TOML file describes, and print it."""
    return _show_launched(asked.client.campaigns.create(asked.spec), quiet)


@app.command()
@prints_answer(opened_by=open_with_spec)
def check(asked: SpecRequest, quiet: QuietCheck = False) -> render.CommandResult:
    """Print the full specification of the campaign in a TOML file without launching it.

    Exits with 2 if it cannot be launched.
    """
    found = asked.client.campaigns.check(asked.spec)
    exit_code = make_error(found.problems[0]).exit_code if found.problems else 0
    if quiet:
        raise typer.Exit(exit_code)
    return render.CommandResult(found, describe_check(found), exit_code=exit_code)


@app.command()
@prints_answer()
def clone(
    client: Client,
    campaign: options.CampaignId,
    name: Annotated[str | None, typer.Option(help="Name of the new campaign.")] = None,
    episodes: Annotated[
        int | None, typer.Option(min=1, help="Budget of the new campaign. [episodes]")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of the new campaign.")] = None,
    values: options.Changed = None,
    quiet: Quiet = False,
) -> render.CommandResult:
    """Launch a copy of an earlier campaign with changed values, and print it."""
    given = {"name": name, "episodes": episodes, "seed": seed}
    named = {field: value for field, value in given.items() if value is not None}
    changes = {**named, **parse_changes(values or [])}
    return _show_launched(client.campaigns.clone(campaign, **changes), quiet)


def _show_launched(campaign: Campaign, quiet: bool) -> render.CommandResult:
    """Return a campaign that was just launched, or its id alone, which is JSON, too."""
    if quiet:
        return render.CommandResult(campaign.id, str(campaign.id))
    return _show_facts(campaign)


def _show_facts(campaign: Campaign) -> render.CommandResult:
    return render.CommandResult(campaign, presentation.list_campaign_facts(campaign))


Ids = Annotated[
    list[int],
    typer.Argument(
        metavar="CAMPAIGN...",
        min=1,
        help="One campaign, or several.",
        autocompletion=completion.complete_campaigns,
    ),
]

Act = Callable[[Campaigns, int], Campaign]

ACTS: dict[str, tuple[Act, str]] = {
    "pause": (Campaigns.pause, "Pause campaigns; their running episodes are finished and kept."),
    "resume": (Campaigns.resume, "Resume paused campaigns."),
    "cancel": (Campaigns.cancel, "Cancel campaigns; their finished episodes are kept."),
    "archive": (
        Campaigns.archive,
        "Archive campaigns that have ended: lists omit them, and nothing of them is deleted.",
    ),
    "restore": (Campaigns.restore, "List archived campaigns again."),
}


def _make_command(act: Act) -> Callable[..., None]:
    """Return a command that acts on campaigns, and prints the state of each."""

    @prints_answer()
    def command(client: Client, campaigns: Ids) -> render.CommandResult:
        changed: list[Campaign] = []
        try:
            changed.extend(act(client.campaigns, each) for each in dict.fromkeys(campaigns))
        except EigenfailError:
            # What was done before stays done.
            for each in changed:
                typer.echo(_tell_state(each), err=True)
            raise
        return render.CommandResult(changed, *map(_tell_state, changed))

    return command


def _tell_state(campaign: Campaign) -> str:
    state = "archived: lists omit it" if campaign.archived_ms else campaign.state
    return f"Campaign {campaign.id} '{campaign.spec.name}' is {state}."


State = Annotated[CampaignState | None, typer.Option(help="Only campaigns in this state.")]
Method = Annotated[
    str | None,
    typer.Option(
        help="Only campaigns of this method.",
        autocompletion=completion.complete_plugins(plugins.METHODS),
    ),
]
Search = Annotated[
    str | None,
    typer.Option(help="Only campaigns whose name contains this text, ignoring case."),
]
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


@app.command("list")
@prints_answer()
def list_campaigns(
    client: Client,
    state: State = None,
    method: Method = None,
    search: Search = None,
    project: options.Project = None,
    tag: Tag = None,
    planner_version: PlannerVersion = None,
    sort: Sort = str(NEWEST_FIRST),
    archived: Archived = False,
    limit: options.Limit = 20,
    watched: options.Watched = False,
) -> render.TerminalView[tuple[Campaign, ...]]:
    """List campaigns, by default newest first."""
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
    return render.TerminalView(
        look=lambda: found.first(limit),
        campaigns=lambda seen: seen,
        to_data=lambda seen: seen,
        describe=lambda seen: (presentation.tabulate_campaigns(seen),),
        watched=watched,
    )


@app.command("show")
@prints_answer()
def show_campaign(
    client: Client, campaign: options.CampaignId, watched: options.Watched = False
) -> render.TerminalView[tuple[Campaign, Summary]]:
    """Show the settings, progress and results of a campaign."""
    return render.TerminalView(
        look=lambda: (client.campaigns.get(campaign), client.campaigns.summary(campaign)),
        campaigns=lambda seen: seen[:1],
        to_data=lambda seen: seen[0],
        describe=lambda seen: (
            *presentation.describe_campaign(*seen),
            *render.find_missing_workers(client, seen[0]),
            *render.describe_method_result(client, seen[0]),
        ),
        watched=watched,
    )


@app.command()
@prints_answer("Reading the episodes")
def course(
    client: Client,
    campaign: options.CampaignId,
    per: Annotated[int | None, typer.Option(min=1, help="Number of episodes in a block.")] = None,
) -> render.CommandResult:
    """Show how failure rate, likelihood and robustness moved: the learning curve."""
    found = client.campaigns.course(campaign, per)
    unit = find_robustness_unit(client.campaigns.get(campaign).spec)
    return render.CommandResult(found, *presentation.tabulate_course(found, unit))


for _name, (_act, _text) in ACTS.items():
    app.command(_name, help=_text)(_make_command(_act))


@app.command()
@prints_answer()
def priority(
    client: Client,
    campaign: options.CampaignId,
    wanted: Annotated[Priority, typer.Argument(metavar="PRIORITY", help="low, normal or high.")],
) -> render.CommandResult:
    """Change the priority of a campaign: its share of the workers and its place in the queue."""
    return _show_facts(client.campaigns.prioritise(campaign, wanted))


@app.command()
@prints_answer("Reading the results")
def digest(client: Client, campaign: options.CampaignId) -> render.CommandResult:
    """Print the digest over all results.

    The same campaign has the same digest with the same release and kind of processor.
    """
    found = client.campaigns.digest(campaign)
    return render.CommandResult({"campaign": campaign, "digest": found}, found)


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
        ended = render.follow(client, campaign)
        summary = client.campaigns.summary(campaign)
        words = render.describe_method_result(client, ended)
    # Printed before it is judged: a gate that fails ends the command.
    render.show(summary, as_json, presentation.tabulate_results([summary]), *words)
    render.judge(ended, gate, summary)


@app.command()
@prints_answer("Reading the measures")
def safety(
    client: Client, campaign: options.CampaignId, level: Level = TAIL_LEVEL
) -> render.CommandResult:
    """Show collisions, near misses, MinTTC, DRAC and severity of a campaign's episodes."""
    found = client.campaigns.safety(campaign, level)
    return render.CommandResult(found, *presentation.describe_safety(found))


@app.command()
@prints_answer("Reading the costs")
def cost(client: Client, campaigns: Ids) -> render.CommandResult:
    """Show cost per failure and per failure mode, cost over time, and the use of time.

    A Monte Carlo campaign without a failure shows a lower bound of the cost per failure (95 %).
    """
    found = [client.campaigns.cost(campaign) for campaign in campaigns]
    return render.CommandResult(found, *presentation.describe_costs(found))


@app.command()
@prints_answer()
def workers(client: Client, campaign: options.CampaignId) -> render.CommandResult:
    """Show the workers that ran a campaign's episodes, with their number and speed."""
    found = client.campaigns.workers(campaign)
    return render.CommandResult(found, presentation.tabulate_workers(found))
