"""`eigenfail episode`: look at episodes, and run them again."""

from itertools import islice
from math import inf
from typing import Annotated

import typer
from rich.console import Group
from rich.text import Text

from eigenfail.cli.episode_tables import episode_facts, episode_table
from eigenfail.cli.explanations import Window, drawn, explanation_of
from eigenfail.cli.minimal_words import minimal_words
from eigenfail.cli.options import (
    DEFAULT_URL,
    AsJson,
    CampaignId,
    EpisodeId,
    Limit,
    Url,
    episode_id,
)
from eigenfail.cli.output import show
from eigenfail.cli.progress import follow
from eigenfail.cli.replays import Replayed, explain_episode, replay_episode
from eigenfail.cli.signals import interruptible
from eigenfail.cli.surroundings import client_at
from eigenfail.cli.tables import facts
from eigenfail.cli.verdict import judge
from eigenfail.client.campaigns import SHRINK_WITHIN
from eigenfail.values import Outcome
from eigenfail.values.records import EpisodeOrder
from eigenfail.variations import drawn_for

DIFFERENT = 1

app = typer.Typer(
    add_completion=False, no_args_is_help=True, help="Look at episodes, and run them again."
)

Every = Annotated[int, typer.Option(min=1, help="Show every n-th step only.")]
From = Annotated[float, typer.Option("--from", help="Show steps from this time on. [s]")]
To = Annotated[
    float, typer.Option("--to", show_default="the end", help="Show steps up to this time. [s]")
]
Replays = Annotated[int, typer.Option("--episodes", min=1, help="Budget of replays.")]
OnlyOutcome = Annotated[Outcome | None, typer.Option(help="Only episodes that ended like this.")]
Sort = Annotated[EpisodeOrder, typer.Option(help="By index, or the worst collision first.")]


@app.command("list")
def list_episodes(
    context: typer.Context,
    campaign: CampaignId,
    url: Url = DEFAULT_URL,
    outcome: OnlyOutcome = None,
    sort: Sort = EpisodeOrder.INDEX,
    limit: Limit = 20,
    as_json: AsJson = False,
) -> None:
    """List the episodes of a campaign."""
    with client_at(context, url) as client:
        found = list(islice(client.episodes.list(campaign, outcome, sort), limit))
    show(found, as_json, lambda: episode_table(found))


@app.command("show")
def show_episode(
    context: typer.Context,
    episode: EpisodeId,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Show one episode; with --json its noise and scene, too."""
    campaign, index = episode_id(episode)
    with client_at(context, url) as client:
        found = client.episodes.get(campaign, index)
        spec = client.campaigns.get(campaign).spec
    drawn_here = drawn_for(spec, found.seed)
    show(found, as_json, lambda: episode_facts(campaign, found, drawn_here))


@app.command()
def replay(
    context: typer.Context,
    episode: EpisodeId,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Run a stored episode again, here, and compare; exit with 1 if it differs."""
    campaign, index = episode_id(episode)
    with client_at(context, url) as client:
        stored = client.episodes.get(campaign, index)
        spec = client.campaigns.get(campaign).spec
    replayed = replay_episode(spec, stored)
    show(replayed, as_json, lambda: facts(rows(episode, replayed)))
    if not replayed.same:
        raise typer.Exit(DIFFERENT)


@app.command()
def explain(
    context: typer.Context,
    episode: EpisodeId,
    url: Url = DEFAULT_URL,
    every: Every = 1,
    since_s: From = 0.0,
    until_s: To = inf,
    as_json: AsJson = False,
) -> None:
    """Run a stored episode again, and let the planner say why it did what it did.

    Exits with 1 if the run differs from the stored one.
    """
    campaign, index = episode_id(episode)
    with client_at(context, url) as client:
        stored = client.episodes.get(campaign, index)
        spec = client.campaigns.get(campaign).spec
    replayed, explained = explain_episode(spec, stored)
    window = Window(since_s, until_s, every)
    explanation = explanation_of(episode, spec.planner, replayed, explained, window)
    show(explanation, as_json, lambda: drawn(explanation))
    if not replayed.same:
        raise typer.Exit(DIFFERENT)


@app.command()
def shrink(
    context: typer.Context,
    episode: EpisodeId,
    url: Url = DEFAULT_URL,
    replays: Replays = SHRINK_WITHIN,
    as_json: AsJson = False,
) -> None:
    """Launch a campaign that finds how little noise a failure needs, and tell what it found."""
    campaign, index = episode_id(episode)
    with interruptible(), client_at(context, url) as client:
        ended = follow(client, client.campaigns.shrink(campaign, index, replays).id)
        judge(ended, gate=False)
        found = client.campaigns.minimal(ended.id)
    show(found, as_json, lambda: Group(*map(Text, minimal_words(found))))


def rows(episode: str, replayed: Replayed) -> list[tuple[str, str]]:
    """What the comparison says."""
    verdict = "the same, bit for bit" if replayed.same else "DIFFERENT"
    return [
        ("episode", episode),
        ("stored", f"{replayed.stored_outcome} {replayed.stored_digest}"),
        ("replayed", f"{replayed.outcome} {replayed.digest}"),
        ("result", verdict),
    ]
