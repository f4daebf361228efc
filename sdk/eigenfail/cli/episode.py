"""`eigenfail episode`: look at episodes, and run them again."""

from itertools import islice
from pathlib import Path
from typing import Annotated

import typer

from eigenfail.cli.episode_runs import explain, replay, shrink, stored_episode
from eigenfail.cli.episode_tables import episode_facts, episode_table, picked_table
from eigenfail.cli.options import (
    DEFAULT_URL,
    AsJson,
    CampaignId,
    EpisodeId,
    Limit,
    Url,
    episode_id,
)
from eigenfail.cli.output import show, to_json
from eigenfail.cli.surroundings import client_at
from eigenfail.filters import parse_fields
from eigenfail.hosting.signals import interruptible
from eigenfail.values import Outcome
from eigenfail.values.export import ExportFormat
from eigenfail.variations import drawn_for

app = typer.Typer(
    add_completion=False, no_args_is_help=True, help="Look at episodes, and run them again."
)

OnlyOutcome = Annotated[Outcome | None, typer.Option(help="Only episodes that ended like this.")]
Filter = Annotated[
    str,
    typer.Option("--filter", help='Conditions, such as "severity > 80 and min_ttc_s < 1.5".'),
]
Sort = Annotated[str, typer.Option(help="A column, or -column for the largest first.")]
Fields = Annotated[
    str, typer.Option(show_default="all", help="Only these columns, with commas in between.")
]
Output = Annotated[
    Path, typer.Option("--output", "-o", help="File to write; its name says as what.")
]
Format = Annotated[
    ExportFormat | None,
    typer.Option("--format", show_default="by the file's name", help="As what to write it."),
]
Noise = Annotated[bool, typer.Option("--noise", help="With each episode's noise; in Parquet.")]


@app.command("list")
def list_episodes(
    context: typer.Context,
    campaign: CampaignId,
    url: Url = DEFAULT_URL,
    outcome: OnlyOutcome = None,
    conditions: Filter = "",
    sort: Sort = "index",
    fields: Fields = "",
    limit: Limit = 20,
    as_json: AsJson = False,
) -> None:
    """List the episodes of a campaign."""
    columns = parse_fields(fields)
    asked = {"filter": conditions, "sort": sort}
    with client_at(context, url) as client:
        if columns:
            picked = client.episodes.list(campaign, outcome, **asked, fields=columns)
            lines = list(islice(picked, limit))
            show(lines, as_json, lambda: picked_table(columns, lines))
            return
        found = list(islice(client.episodes.list(campaign, outcome, **asked), limit))
    show(found, as_json, lambda: episode_table(found))


@app.command()
def export(
    context: typer.Context,
    campaign: CampaignId,
    output: Output,
    url: Url = DEFAULT_URL,
    form: Format = None,
    conditions: Filter = "",
    sort: Sort = "index",
    fields: Fields = "",
    noise: Noise = False,
    as_json: AsJson = False,
) -> None:
    """Write episodes of a campaign to a file: CSV, NDJSON or Parquet."""
    with interruptible(), client_at(context, url) as client:
        client.episodes.export(
            campaign,
            output,
            form,
            filter=conditions,
            sort=sort,
            fields=parse_fields(fields),
            noise=noise,
        )
    if as_json:
        typer.echo(to_json({"file": str(output), "size_bytes": output.stat().st_size}))
        return
    typer.echo(f"{output} is written.", err=True)


@app.command("show")
def show_episode(
    context: typer.Context,
    episode: EpisodeId,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Show one episode; with --json its noise and scene, too."""
    found, spec = stored_episode(context, url, episode)
    drawn_here = drawn_for(spec, found.seed)
    show(found, as_json, lambda: episode_facts(episode_id(episode)[0], found, drawn_here))


for page in (replay, explain, shrink):
    app.command()(page)
