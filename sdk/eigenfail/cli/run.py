"""`eigenfail run`: from a TOML file to a result table, starting whatever is missing."""

import typer

from eigenfail.cli.interruption import follow_or_pause
from eigenfail.cli.minimal_words import shrunk, with_words
from eigenfail.cli.options import (
    DEFAULT_DATA,
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
from eigenfail.cli.output import show
from eigenfail.cli.places import MaybeUrl, client_somewhere
from eigenfail.cli.specs import read_spec
from eigenfail.cli.tables import result_table
from eigenfail.cli.verdict import judge
from eigenfail.hosting.service import Plan

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
    Ctrl-C pauses the campaign and says how to go on.
    """
    stop = {
        "failures": stop_failures,
        "half_width": stop_half_width,
        "cv": stop_cv,
        "wall_s": stop_wall_s,
        "cost_usd": stop_cost_usd,
    }
    spec = read_spec(file, stop, episodes=episodes, seed=seed, priority=priority)
    with client_somewhere(context, spec, url, Plan(data, 0, workers)) as (client, place):
        created = client.campaigns.create(spec)
        ended = follow_or_pause(client, created.id, place.check, place.again)
        summary = client.campaigns.summary(ended.id)
        words = shrunk(client, ended)
    show(summary, as_json, lambda: with_words(result_table([summary]), words))
    judge(ended, gate)
