"""`eigenfail episode replay`, `explain` and `shrink`: episodes that are run again."""

from math import inf
from typing import Annotated

import typer
from msgspec.structs import replace
from rich.console import Group
from rich.text import Text

from eigenfail.cli.explanations import drawn
from eigenfail.cli.minimal_words import minimal_words
from eigenfail.cli.options import DEFAULT_URL, AsJson, EpisodeId, Url, episode_id
from eigenfail.cli.output import show
from eigenfail.cli.progress import follow
from eigenfail.cli.surroundings import client_at
from eigenfail.cli.tables import facts
from eigenfail.cli.verdict import judge
from eigenfail.client.campaigns import SHRINK_WITHIN
from eigenfail.errors import NoisePruned, NotFound
from eigenfail.hosting.signals import interruptible
from eigenfail.stories.explanations import Window, explanation_of
from eigenfail.stories.replays import explain_episode, redraw_episode, replay_episode
from eigenfail.values import CampaignSpec, Replayed
from eigenfail.values.records import EpisodeDetail
from eigenfail.versions import differences, versions

DIFFERENT = 1

Every = Annotated[int, typer.Option(min=1, help="Show every n-th step only.")]
From = Annotated[float, typer.Option("--from", help="Show steps from this time on. [s]")]
To = Annotated[
    float, typer.Option("--to", show_default="the end", help="Show steps up to this time. [s]")
]
Replays = Annotated[int, typer.Option("--episodes", min=1, help="Budget of replays.")]


def replay(
    context: typer.Context,
    episode: EpisodeId,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Run a stored episode again, here, and compare; exit with 1 if it differs.

    Where its noise was pruned, and follows from its seed, it is drawn again.
    """
    replayed = run_again(context, url, episode)
    if not replayed.same:
        replayed = replace(replayed, differing=differing(context, url, episode))
    show(replayed, as_json, lambda: facts(rows(episode, replayed)))
    if not replayed.same:
        raise typer.Exit(DIFFERENT)


def run_again(context: typer.Context, url: str, episode: str) -> Replayed:
    """Its second run, with its noise as it is stored, or drawn again from its seed."""
    try:
        stored, spec = stored_episode(context, url, episode)
    except NoisePruned:
        campaign, index = episode_id(episode)
        with client_at(context, url) as client:
            only = f"index = {index}"
            row = next(iter(client.episodes.list(campaign, filter=only)))
            spec = client.campaigns.get(campaign).spec
        return redraw_episode(spec, row)
    return replay_episode(spec, stored)


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
    stored, spec = stored_episode(context, url, episode)
    replayed, explained = explain_episode(spec, stored)
    window = Window(since_s, until_s, every)
    explanation = explanation_of(episode, spec.planner, replayed, explained, window)
    show(explanation, as_json, lambda: drawn(explanation))
    if not replayed.same:
        raise typer.Exit(DIFFERENT)


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


def stored_episode(
    context: typer.Context, url: str, episode: str
) -> tuple[EpisodeDetail, CampaignSpec]:
    """An episode that is written as CAMPAIGN/INDEX, and what was asked of its campaign."""
    campaign, index = episode_id(episode)
    with client_at(context, url) as client:
        return client.episodes.get(campaign, index), client.campaigns.get(campaign).spec


def differing(context: typer.Context, url: str, episode: str) -> tuple[str, ...] | None:
    """The versions that are not what they were when it was run; None if those are not known."""
    campaign, index = episode_id(episode)
    with client_at(context, url) as client:
        try:
            return differences(client.episodes.worker(campaign, index).versions, versions())
        except NotFound:
            return None


def rows(episode: str, replayed: Replayed) -> list[tuple[str, str]]:
    """What the comparison says."""
    verdict = "the same, bit for bit" if replayed.same else f"DIFFERENT: {why(replayed)}"
    return [
        ("episode", episode),
        ("stored", f"{replayed.stored_outcome} {replayed.stored_digest}"),
        ("replayed", f"{replayed.outcome} {replayed.digest}"),
        ("result", verdict),
    ]


def why(replayed: Replayed) -> str:
    """What may be the cause of a difference."""
    if replayed.differing is None:
        return "the versions that it was run with are not known"
    return "; ".join(replayed.differing) or "the versions are the same, something is left to chance"
