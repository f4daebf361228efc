"""`eigenfail suite`: many campaigns from one TOML file, run, resumed and shown as one."""

from pathlib import Path
from typing import Annotated

import typer

from eigenfail.cli import render
from eigenfail.cli.answers import prints_answer
from eigenfail.cli.connection import MaybeUrl, Place, connect_for_suite
from eigenfail.cli.options import AsJson, Data, Gate, Limit, Workers
from eigenfail.client import Client
from eigenfail.errors import ServiceError
from eigenfail.hosting.folder import DEFAULT_DATA
from eigenfail.hosting.service import Plan
from eigenfail.presentation import suites
from eigenfail.progress import announce
from eigenfail.suites import Suite
from eigenfail.values.campaign import Campaign, CampaignState

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Run many campaigns as one: a sweep, a grid, or a list of them.",
)

SuiteFile = Annotated[
    Path,
    typer.Argument(metavar="FILE.toml", help="The suite: a base, and what varies, as TOML."),
]
SuiteOrFile = Annotated[
    str,
    typer.Argument(metavar="NAME|FILE.toml", help="A suite that the service knows, or its file."),
]
DryRun = Annotated[
    bool,
    typer.Option("--dry-run", help="Print the campaigns and their budget without running them."),
]


@app.command()
def run(
    context: typer.Context,
    file: SuiteFile,
    url: MaybeUrl = None,
    data: Data = DEFAULT_DATA,
    workers: Workers = 0,
    dry_run: DryRun = False,
    gate: Gate = False,
    as_json: AsJson = False,
) -> None:
    """Run the missing campaigns of a suite, wait for its end, and print its table.

    Campaigns that the service has run before are not run again. Ctrl-C pauses the suite; the
    same command resumes it. Where it runs is decided as by `eigenfail run`.
    """
    suite = Suite.read(file)
    if dry_run:
        plan = suites.SuitePlan(suite.name, len(suite.members), suite.episodes, suite.members)
        render.show(plan, as_json, suites.tabulate_plan(plan))
        # Nothing was asked of a service, so that nothing can be judged.
        raise typer.Exit
    command, place = f"eigenfail suite run {file}", Plan(data, 0, workers)
    ended, result, _ = run_and_show(context, suite, url, place, command, as_json)
    judge_all(ended, gate, result)


def run_and_show(
    context: typer.Context, suite: Suite, url: str | None, plan: Plan, command: str, as_json: bool
) -> tuple[tuple[Campaign, ...], suites.SuiteResult, Place]:
    """Run the missing campaigns of a suite, print its results, and return both with the service.

    Args:
        context: of the command.
        suite: the campaigns.
        url: address of a service that runs already; None finds or starts one.
        plan: the service that is started if none runs.
        command: the command that continues the suite after Ctrl-C.
        as_json: whether to print JSON.
    """
    with connect_for_suite(context, suite, url, plan) as (client, place):
        ended = render.run_suite(client, suite, place.check, command)
        result = summarize_suite(client, suite)
    render.show(result, as_json, *suites.describe_suite_result(result))
    return ended, result, place


@app.command("list")
@prints_answer()
def list_suites(client: Client, limit: Limit = 50) -> render.CommandResult:
    """List the suites that a service knows, those with the newest campaigns first."""
    return render.first_rows(client.suites.list(), limit, suites.tabulate_suites)


@app.command("show")
@prints_answer()
def show_suite(client: Client, suite: SuiteOrFile) -> render.CommandResult:
    """Show the table of a suite as it stands.

    Of a file: all of its members, also those that have no campaign yet. Of a name: the newest
    campaign of each member that the service knows, and the settings in which members differ.
    """
    if suite.endswith(".toml") or Path(suite).is_file():
        result = summarize_suite(client, Suite.read(suite))
        return render.CommandResult(result, *suites.describe_suite_result(result))
    with announce(f"Reading the results of {suite}"):
        found = client.suites.table(suite)
    return render.CommandResult(found, *suites.describe_suite(found))


def summarize_suite(client: Client, suite: Suite) -> suites.SuiteResult:
    """Return the results of the members of a suite so far, in order."""
    with announce(f"Reading the results of {suite.name}"):
        campaigns, summaries = client.suites.find(suite), client.suites.summaries(suite)
        over_seeds = client.suites.over_seeds(suite)
    members = tuple(
        suites.MemberResult(member.name, campaign.state, campaign.stopped_because, summary)
        if campaign
        else suites.MemberResult(member.name)
        for member, campaign, summary in zip(suite.members, campaigns, summaries, strict=True)
    )
    return suites.SuiteResult(suite.name, suite.episodes, members, over_seeds)


def judge_all(campaigns: tuple[Campaign, ...], gate: bool, result: suites.SuiteResult) -> None:
    """Exit with 1 if a gate was asked for and any campaign found failures.

    Raises:
        ServiceError: one came to nothing: it is dead, or all of its episodes errored.
    """
    members = (member.summary for member in result.members if member.summary)
    summaries = {summary.campaign: summary for summary in members}

    def rank_badness(campaign: Campaign) -> tuple[bool, ...]:
        # A dead campaign first: its failures are no reason why the suite came to nothing.
        is_dead = campaign.state is CampaignState.DEAD
        return not is_dead, not campaign.is_errored, not campaign.counts.failures

    for campaign in sorted(campaigns, key=rank_badness):
        summary = summaries.get(campaign.id)
        if campaign.is_errored:
            # A suite that is run again takes up its campaigns where they stopped, also this one.
            error = render.make_errored_error(campaign, summary)
            again = "After fixing the cause, run the suite under a different name."
            raise ServiceError(error.problem, f"{error.remedy}. {again}")
        render.judge(campaign, gate, summary)
