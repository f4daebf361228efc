"""`eigenfail analyze`: failures into modes, and modes into replays."""

from enum import StrEnum
from typing import Annotated

import typer

from eigenfail.cli.finding_words import finding_words
from eigenfail.cli.mode_tables import (
    component_words,
    distinctness_words,
    diversity_words,
    mode_table,
)
from eigenfail.cli.options import DEFAULT_URL, AsJson, CampaignId, Url
from eigenfail.cli.output import console, to_json
from eigenfail.cli.proofs import Prove, Variations, proof_table, proof_words, proven
from eigenfail.cli.surroundings import client_at
from eigenfail.client import Client
from eigenfail.errors import Conflict
from eigenfail.hosting.signals import interruptible
from eigenfail.settings import convert
from eigenfail.values import Analysis, AnalysisResult, AnalysisSettings, AnalysisState, Proof

app = typer.Typer(add_completion=False)


class Align(StrEnum):
    """Where trajectories are put side by side."""

    START = "start"
    COLLISION = "collision"


class Axes(StrEnum):
    """Which axes of the noise are analysed."""

    JOINT = "joint"
    LONGITUDINAL = "longitudinal"
    LATERAL = "lateral"


class Clusterer(StrEnum):
    """What finds the modes."""

    KMEANS = "kmeans"
    HDBSCAN = "hdbscan"
    GAUSSIAN_MIXTURE = "gaussian_mixture"


AlignAt = Annotated[Align, typer.Option(help="Put trajectories side by side at this moment.")]
Components = Annotated[int, typer.Option(help="Principal components.")]
Clusters = Annotated[int | None, typer.Option(help="Failure modes; by silhouette if not given.")]
AxesChoice = Annotated[Axes, typer.Option(help="Both axes together, or one apart.")]
ClustererChoice = Annotated[Clusterer, typer.Option(help="What finds the modes.")]
Also = Annotated[
    list[int] | None,
    typer.Option(
        "--also",
        metavar="CAMPAIGN",
        min=1,
        help="Another campaign to analyse with it; may be repeated.",
    ),
]
Bootstrap = Annotated[
    int, typer.Option(help="How often the failures are drawn again to see if the modes come back.")
]


@app.command()
def analyze(
    context: typer.Context,
    campaign: CampaignId,
    url: Url = DEFAULT_URL,
    align: AlignAt = Align.START,
    components: Components = 3,
    clusters: Clusters = None,
    axes: AxesChoice = Axes.JOINT,
    clusterer: ClustererChoice = Clusterer.KMEANS,
    also: Also = None,
    bootstrap: Bootstrap = 20,
    prove: Prove = False,
    variation: Variations = None,
    as_json: AsJson = False,
) -> None:
    """Group the failures of a campaign into failure modes.

    With --prove every eigenfailure and medoid is replayed, in the same scenario and in others, and
    it is said how many fail again.
    """
    given = {
        "align": align.value,
        "components": components,
        "clusters": clusters,
        "axes": axes.value,
        "clusterer": clusterer.value,
        "campaigns": also or [],
        "bootstrap": bootstrap,
    }
    settings = convert(given, AnalysisSettings)
    with interruptible(), client_at(context, url) as client:
        analysis = finished(client, campaign, settings)
        proof = proven(client, analysis.id, variation or ()) if prove else None
    if as_json:
        typer.echo(to_json({"analysis": analysis, "proof": proof}))
    elif analysis.result:
        tell(campaign, analysis.result, proof)


def finished(client: Client, campaign: int, settings: AnalysisSettings) -> Analysis:
    """A new analysis of the campaign, done.

    Raises:
        Conflict: there is nothing to analyse.
    """
    analysis = client.analyses.wait(client.analyses.create(campaign, settings).id)
    if analysis.state is AnalysisState.FAILED:
        raise Conflict(f"Campaign {campaign} cannot be analysed: {analysis.problem}")
    return analysis


def tell(campaign: int, result: AnalysisResult, proof: Proof | None) -> None:
    """Print the modes, what they are worth, and whether they fail again."""
    screen = console()
    screen.print(mode_table(campaign, result))
    screen.print(component_words(result))
    screen.print(distinctness_words(result))
    for words in (*diversity_words(result), *finding_words(result), *result.words):
        screen.print(words)
    if proof is not None:
        screen.print(proof_table(proof))
        for words in proof_words(proof):
            screen.print(words)
