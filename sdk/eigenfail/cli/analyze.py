"""`eigenfail analyze`: failures into modes, and modes into replays."""

from enum import StrEnum
from typing import Annotated

import typer

from eigenfail.cli.mode_tables import (
    component_words,
    distinctness_words,
    diversity_words,
    mode_table,
    replay_words,
)
from eigenfail.cli.options import DEFAULT_URL, AsJson, CampaignId, Url
from eigenfail.cli.output import console, to_json
from eigenfail.cli.progress import follow
from eigenfail.cli.signals import interruptible
from eigenfail.cli.surroundings import client_at
from eigenfail.client import Client
from eigenfail.errors import Conflict
from eigenfail.settings import convert
from eigenfail.values import Analysis, AnalysisResult, AnalysisSettings, AnalysisState, Summary

app = typer.Typer(add_completion=False)


class Align(StrEnum):
    """Where trajectories are put side by side."""

    START = "start"
    COLLISION = "collision"


AlignAt = Annotated[Align, typer.Option(help="Put trajectories side by side at this moment.")]
Components = Annotated[int, typer.Option(help="Principal components.")]
Clusters = Annotated[int | None, typer.Option(help="Failure modes; by silhouette if not given.")]
Replay = Annotated[bool, typer.Option("--replay", help="Replay the eigenfailures, too.")]


@app.command()
def analyze(
    context: typer.Context,
    campaign: CampaignId,
    url: Url = DEFAULT_URL,
    align: AlignAt = Align.START,
    components: Components = 3,
    clusters: Clusters = None,
    replay: Replay = False,
    as_json: AsJson = False,
) -> None:
    """Group the failures of a campaign into failure modes.

    With --replay a campaign replays every eigenfailure, and it is said how many fail again.
    """
    given = {"align": align.value, "components": components, "clusters": clusters}
    settings = convert(given, AnalysisSettings)
    with interruptible(), client_at(context, url) as client:
        analysis = finished(client, campaign, settings)
        replayed = replay_modes(client, analysis) if replay else None
    if as_json:
        typer.echo(to_json({"analysis": analysis, "replay": replayed}))
    elif analysis.result:
        tell(campaign, analysis.result, replayed)


def finished(client: Client, campaign: int, settings: AnalysisSettings) -> Analysis:
    """A new analysis of the campaign, done.

    Raises:
        Conflict: there is nothing to analyse.
    """
    analysis = client.analyses.wait(client.analyses.create(campaign, settings).id)
    if analysis.state is AnalysisState.FAILED:
        raise Conflict(f"Campaign {campaign} cannot be analysed: {analysis.problem}")
    return analysis


def replay_modes(client: Client, analysis: Analysis) -> Summary:
    """Replay the eigenfailures of an analysis, to the end."""
    replayed = follow(client, client.analyses.replay(analysis.id).id)
    return client.campaigns.summary(replayed.id)


def tell(campaign: int, result: AnalysisResult, replayed: Summary | None) -> None:
    """Print the modes, what they are worth, and whether they fail again."""
    screen = console()
    screen.print(mode_table(campaign, result))
    screen.print(component_words(result))
    screen.print(distinctness_words(result))
    for words in diversity_words(result):
        screen.print(words)
    if replayed is not None:
        screen.print(replay_words(replayed))
