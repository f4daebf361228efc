"""`eigenfail suite`: many campaigns from one TOML file, run, resumed and shown as one."""

from pathlib import Path
from typing import Annotated

import typer

from eigenfail.cli.options import DEFAULT_DATA, DEFAULT_URL, AsJson, Data, Gate, Limit, Url, Workers
from eigenfail.cli.output import show
from eigenfail.cli.places import MaybeUrl, client_of_suite
from eigenfail.cli.suite_lists import named_suite, suite_list
from eigenfail.cli.suite_tables import SuiteResult, plan_of, plan_table, result_of, suite_table
from eigenfail.cli.surroundings import client_at
from eigenfail.cli.together import run_together
from eigenfail.cli.verdict import judge
from eigenfail.client import Client
from eigenfail.hosting.service import Plan
from eigenfail.suites import Suite
from eigenfail.values import Campaign, CampaignState

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
    bool, typer.Option("--dry-run", help="Say what would be run and its budget, and end.")
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
    """Run what is missing of a suite, follow it to its end, and print its table.

    What the service has done of it before is found and not done again. Ctrl-C pauses all of it;
    the same command goes on. Where it runs is decided as by `eigenfail run`.
    """
    suite = Suite.read(file)
    if dry_run:
        plan = plan_of(suite)
        show(plan, as_json, lambda: plan_table(plan))
        raise typer.Exit
    with client_of_suite(context, suite, url, Plan(data, 0, workers)) as (client, place):
        ended = run_together(client, suite, place.check, f"eigenfail suite run {file}")
        result = stand_of(client, suite)
    show(result, as_json, lambda: suite_table(result))
    judge_all(ended, gate)


@app.command("list")
def list_suites(
    context: typer.Context, limit: Limit = 50, url: Url = DEFAULT_URL, as_json: AsJson = False
) -> None:
    """List the suites that a service knows, those with the newest campaigns first."""
    with client_at(context, url) as client:
        suites = client.suites.list().first(limit)
    show(suites, as_json, lambda: suite_list(suites))


@app.command("show")
def show_suite(
    context: typer.Context,
    suite: SuiteOrFile,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Show the table of a suite as it stands.

    Of a file: all of its members, also those that have no campaign yet. Of a name: the newest
    campaign of each member that the service knows, and the settings in which members differ.
    """
    with client_at(context, url) as client:
        if is_file(suite):
            result = stand_of(client, Suite.read(suite))
            show(result, as_json, lambda: suite_table(result))
        else:
            found = client.suites.table(suite)
            show(found, as_json, lambda: named_suite(found))


def is_file(suite: str) -> bool:
    """Whether a file is meant, and not a name."""
    return suite.endswith(".toml") or Path(suite).is_file()


def stand_of(client: Client, suite: Suite) -> SuiteResult:
    """What came of a suite so far."""
    return result_of(suite, client.suites.find(suite), client.suites.summaries(suite))


def judge_all(campaigns: tuple[Campaign, ...], gate: bool) -> None:
    """Exit with 1 if a gate was asked for and any campaign found failures.

    Raises:
        ServiceError: one came to nothing, so that no gate may pass on it.
    """
    for campaign in sorted(campaigns, key=worst_first):
        judge(campaign, gate)


def worst_first(campaign: Campaign) -> tuple[bool, bool]:
    """The dead before all others, then those that found failures."""
    return campaign.state is not CampaignState.DEAD, not campaign.counts.failures
