"""`eigenfail run`: from a TOML file to a result table, starting a service if there is none."""

import typer

from eigenfail.cli.connection import MaybeUrl, connect_for_campaign
from eigenfail.cli.options import (
    AsJson,
    Data,
    Episodes,
    Gate,
    Seed,
    SpecFile,
    StopCost,
    StopCv,
    StopFailures,
    StopHalfWidth,
    StopWall,
    Urgency,
    Workers,
)
from eigenfail.cli.render import describe_method_result, follow_or_pause, judge, show
from eigenfail.cli.specs import read_spec
from eigenfail.hosting.folder import DEFAULT_DATA
from eigenfail.hosting.service import Plan
from eigenfail.presentation.campaigns import tabulate_results
from eigenfail.presentation.terminal import render

app = typer.Typer(add_completion=False)


@app.command()
def run(
    context: typer.Context,
    file: SpecFile,
    url: MaybeUrl = None,
    data: Data = DEFAULT_DATA,
    workers: Workers = 0,
    episodes: Episodes = None,
    seed: Seed = None,
    priority: Urgency = None,
    stop_failures: StopFailures = None,
    stop_half_width: StopHalfWidth = None,
    stop_cv: StopCv = None,
    stop_wall_s: StopWall = None,
    stop_cost_usd: StopCost = None,
    gate: Gate = False,
    as_json: AsJson = False,
) -> None:
    """Run the campaign that a TOML file describes, and print its results.

    Uses the service at --url, or one that runs on the data folder or, if no folder is named, at the
    default address; otherwise starts one on the folder for as long as the campaign takes.
    Ctrl-C pauses the campaign and prints how to resume it.
    """
    stop = {
        "failures": stop_failures,
        "half_width": stop_half_width,
        "cv": stop_cv,
        "wall_s": stop_wall_s,
        "cost_usd": stop_cost_usd,
    }
    spec = read_spec(file, stop, episodes=episodes, seed=seed, priority=priority)
    with connect_for_campaign(context, spec, url, Plan(data, 0, workers)) as (client, place):
        created = client.campaigns.create(spec)
        ended = follow_or_pause(client, created.id, place.check, place.again)
        summary = client.campaigns.summary(ended.id)
        words = describe_method_result(client, ended)
    show(summary, as_json, lambda: render(tabulate_results([summary]), *words))
    if place.again:
        over = "The service that was started for this campaign has ended. To read its results,"
        typer.echo(f"{over} start one in a second terminal: {place.again}", err=True)
    judge(ended, gate, summary)
