"""`eigenfail analyze`: failures into modes, and modes into replays."""

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from eigenfail.cli.connection import connect_to
from eigenfail.cli.options import AsJson, CampaignId, Url
from eigenfail.cli.render import follow, make_console, to_json
from eigenfail.client import Client
from eigenfail.errors import Conflict, InvalidValue, ServiceError
from eigenfail.hosting.folder import DEFAULT_URL
from eigenfail.hosting.processes import interruptible
from eigenfail.presentation import analyses
from eigenfail.presentation.tables import Block
from eigenfail.presentation.terminal import render
from eigenfail.progress import announce
from eigenfail.settings import convert
from eigenfail.values.analysis import (
    Alignment,
    Analysis,
    AnalysisSettings,
    AnalysisState,
    Centre,
    Clusterer,
    FailureChoice,
    Features,
)
from eigenfail.values.proof import Proof
from eigenfail.worlds import find_robustness_unit

app = typer.Typer(add_completion=False)

USUAL = AnalysisSettings()
"""What every option is unless it is given, as in the API, the client and the dashboard's form."""


AlignAt = Annotated[Alignment, typer.Option(help="Moment at which trajectories are aligned.")]
Components = Annotated[int, typer.Option(help="Number of principal components.")]
Clusters = Annotated[
    int | None, typer.Option(help="Number of failure modes (default: by silhouette).")
]
AxesChoice = Annotated[
    str,
    typer.Option(
        metavar="CHANNEL",
        help="Channel of the noise to analyze alone, such as lateral; joint: all together.",
    ),
]
ClustererChoice = Annotated[
    Clusterer, typer.Option(help="Clustering algorithm that finds the modes.")
]
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
    int, typer.Option(help="Number of bootstrap samples for the stability of the modes.")
]


ModeCentre = Annotated[
    Centre,
    typer.Option(help="Centre of a mode that its eigenfailure shows; mean: as in the paper."),
]

FailuresChoice = Annotated[
    FailureChoice,
    typer.Option(help="Of a method that learns, the latest half of the failures, or all."),
]

FeaturesChoice = Annotated[
    Features,
    typer.Option(
        help="What failures are grouped by: the behaviour of the ego before the collision, or "
        "the noise, as in the paper."
    ),
]

Prove = Annotated[
    bool, typer.Option("--prove", help="Replay eigenfailures and medoids, also in other scenarios.")
]
Variations = Annotated[
    list[str] | None,
    typer.Option(
        "--variation",
        metavar="PARAMETERS",
        help='With --prove: a scenario to replay in, such as "distance_m = 53.0"; "" is the same'
        " scenario. Repeat it for more. Not given: the same scenario and its neighbours.",
    ),
]

Animations = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER",
        help="Write an animation of the failures of each mode, over each other, to this folder: "
        "mode-1.gif and so on.",
    ),
]


@app.command()
def analyze(
    context: typer.Context,
    campaign: CampaignId,
    url: Url = DEFAULT_URL,
    align: AlignAt = USUAL.align,
    components: Components = USUAL.components,
    clusters: Clusters = USUAL.clusters,
    axes: AxesChoice = USUAL.axes,
    clusterer: ClustererChoice = USUAL.clusterer,
    also: Also = None,
    bootstrap: Bootstrap = USUAL.bootstrap,
    failures: FailuresChoice = USUAL.failures,
    centre: ModeCentre = USUAL.centre,
    features: FeaturesChoice = USUAL.features,
    prove: Prove = False,
    variation: Variations = None,
    animations: Animations = None,
    as_json: AsJson = False,
) -> None:
    """Group the failures of a campaign into failure modes.

    With --prove, eigenfailures and medoids are replayed in the same scenario and in its
    neighbours, and the number that fail again is printed. If the centre of a mode does not
    fail, the nearest noise that does is searched on the way to its medoid.
    """
    given = {
        "align": align,
        "components": components,
        "clusters": clusters,
        "axes": axes,
        "clusterer": clusterer,
        "campaigns": also or [],
        "bootstrap": bootstrap,
        "failures": failures,
        "centre": centre,
        "features": features,
    }
    settings = convert(given, AnalysisSettings)
    # Before anything is run: an analysis whose animations cannot be written would be in vain.
    if animations is not None:
        try:
            animations.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            problem = f"{animations} cannot be made: {error.strerror or error}."
            raise ServiceError(problem, "Choose a folder that you can write to.") from error
    with interruptible(), connect_to(context, url) as client:
        analysis = find_or_run_analysis(client, campaign, settings)
        proof = prove_analysis(client, analysis.id, variation or ()) if prove else None
        proven: tuple[Block, ...] = ()
        if proof:
            # Robustness has the unit of the world that the campaign ran in.
            unit = find_robustness_unit(client.campaigns.get(analysis.campaign).spec)
            noun = analysis.result.cluster_noun if analysis.result else "mode"
            proven = analyses.describe_proof(proof, noun, unit)
        if as_json:
            typer.echo(to_json({"analysis": analysis, "proof": proof}))
        elif analysis.result:
            result = analysis.result
            found = (
                *analyses.describe_modes(campaign, result),
                *analyses.describe_findings(result),
            )
            place = (
                f"This is analysis {analysis.id}: /analyses/{analysis.id} of the dashboard. Name a "
                f'mode by `eigenfail mode rename {analysis.id} 1 "a name"`.'
            )
            words = (*analyses.list_mode_words(result), place)
            make_console().print(render(*found, *words, *proven))
        # The result is printed first: it is not lost where an animation cannot be made.
        if animations is not None:
            write_animations(client, analysis, animations)


def write_animations(client: Client, analysis: Analysis, folder: Path) -> None:
    """Write an animated GIF of each mode of an analysis to a folder.

    Raises:
        ServiceError: a file cannot be written.
        InvalidValue: the service cannot write the format.
    """
    for number in range(1, len(analysis.result.modes if analysis.result else ()) + 1):
        with announce(f"Drawing the failures of mode {number}"):
            path = client.analyses.animate(analysis.id, number, folder / f"mode-{number}.gif")
        typer.echo(f"Wrote {path}.", err=True)


def find_or_run_analysis(client: Client, campaign: int, settings: AnalysisSettings) -> Analysis:
    """A new analysis of the campaign, done.

    Raises:
        Conflict: there is nothing to analyse.
    """
    with announce(f"Analysing the failures of campaign {campaign}"):
        analysis = client.analyses.wait(client.analyses.create(campaign, settings).id)
    if analysis.state is AnalysisState.FAILED:
        raise Conflict(f"Campaign {campaign} cannot be analysed: {analysis.problem}")
    return analysis


def prove_analysis(client: Client, analysis: int, given: Sequence[str]) -> Proof:
    """The proof of an analysis, once all of its replays have ended.

    Raises:
        InvalidValue: a variation that cannot be read, or outside the scenario's bounds.
    """
    variations = [read_variation(text) for text in given]
    with announce(f"Preparing the replays of analysis {analysis}"):
        launched = client.analyses.prove(analysis, variations or None)
    for scenario in launched.scenarios:
        follow(client, scenario.campaign)
    if client.analyses.proof(analysis).unplaced:
        for search in client.analyses.prove(analysis, variations or None).searches:
            follow(client, search)
    with announce(f"Counting the replays of analysis {analysis}"):
        return client.analyses.proof(analysis)


def read_variation(text: str) -> dict[str, Any]:
    """Scenario parameters as in a TOML file, with commas between them.

    Raises:
        InvalidValue: they are something else.
    """
    try:
        given: dict[str, Any] = tomllib.loads(f"given = {{{text}}}")["given"]
    except tomllib.TOMLDecodeError as error:
        remedy = 'Write it as --variation "distance_m = 53.0, ego_speed_mps = 23.0".'
        raise InvalidValue("--variation", f"'{text}' cannot be read: {error}.", remedy) from None
    return given
