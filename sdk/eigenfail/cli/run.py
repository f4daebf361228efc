"""`eigenfail run`: from a TOML file to a result table, starting a service if there is none."""

import typer

from eigenfail.cli import options
from eigenfail.cli.connection import MaybeUrl, Place, connect_for_campaign, this_command
from eigenfail.cli.render import describe_method_result, follow_or_pause, judge, show
from eigenfail.cli.specs import read_spec
from eigenfail.cli.suite import judge_all, run_and_show
from eigenfail.hosting.folder import DEFAULT_DATA
from eigenfail.hosting.service import Plan
from eigenfail.presentation.campaigns import tabulate_results
from eigenfail.suites import Suite

app = typer.Typer(add_completion=False)


@app.command()
def run(
    context: typer.Context,
    file: options.SpecFile,
    url: MaybeUrl = None,
    data: options.Data = DEFAULT_DATA,
    workers: options.Workers = 0,
    episodes: options.Episodes = None,
    seed: options.Seed = None,
    seeds: options.Seeds = None,
    priority: options.Urgency = None,
    values: options.Changed = None,
    stop_failures: options.StopFailures = None,
    stop_half_width: options.StopHalfWidth = None,
    stop_cv: options.StopCv = None,
    stop_wall_s: options.StopWall = None,
    stop_cost_usd: options.StopCost = None,
    gate: options.Gate = False,
    as_json: options.AsJson = False,
) -> None:
    """Run the campaign that a TOML file describes, and print its results.

    Uses the service at --url, or one that runs on the data folder or, if no folder is named, at the
    default address; otherwise starts one on the folder for as long as the campaign takes.
    Ctrl-C pauses the campaign and prints how to resume it.

    With --seeds N it is run with N seeds, as a suite of its name: the same command goes on where it
    was interrupted, and runs nothing twice. Intervals of means are over seeds.
    """
    stop = {
        "failures": stop_failures,
        "half_width": stop_half_width,
        "cv": stop_cv,
        "wall_s": stop_wall_s,
        "cost_usd": stop_cost_usd,
    }
    spec = read_spec(file, stop, values, episodes=episodes, seed=seed, priority=priority)
    plan = Plan(data, 0, workers)
    # Several seeds are a suite, which the same command resumes after Ctrl-C.
    if seeds is not None:
        suite = Suite.repeat(spec, seeds)
        ended, result, place = run_and_show(context, suite, url, plan, this_command(), as_json)
        _tell_end(place)
        judge_all(ended, gate, result)
        return
    with connect_for_campaign(context, spec, url, plan) as (client, place):
        created = client.campaigns.create(spec)
        campaign = follow_or_pause(client, created.id, place.check, place.again)
        summary = client.campaigns.summary(campaign.id)
        words = describe_method_result(client, campaign)
    show(summary, as_json, tabulate_results([summary]), *words)
    # Printed before it is judged: a gate that fails ends the command.
    _tell_end(place)
    judge(campaign, gate, summary)


def _tell_end(place: Place) -> None:
    """Say that a service that was started for this run has ended, and how to start it again."""
    if place.again:
        over = "The service that was started for this campaign has ended. To read its results,"
        typer.echo(f"{over} start one in a second terminal: {place.again}", err=True)
