"""One analysis: what was found in the failures, and what became of it."""

from collections.abc import Iterator

import msgspec
import numpy as np

from eigenfail.values import (
    Analysis,
    AnalysisResult,
    AnalysisSettings,
    Campaign,
    FailureMode,
    Proof,
    ProvenMode,
)
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.charts import Chart
from eigenfail_api.dashboard.views.findings import Grid, finding_tiles, grids
from eigenfail_api.dashboard.views.lists import AnalysisLine, analysis_line
from eigenfail_api.dashboard.views.modes import (
    eigenfailure_chart,
    explained_chart,
    influence_chart,
    scores_chart,
)
from eigenfail_api.dashboard.views.proof import ProofView, proof_view, tried
from eigenfail_api.dashboard.views.summaries import Figure, probability
from eigenfail_api.dashboard.views.training import training_charts


class ModeCard(msgspec.Struct, frozen=True, kw_only=True):
    """A failure mode; modes are counted from 1 for people.

    Attributes:
        words: what it is; of results of older releases its strongest noise.
        probability: of a failure of this mode, or why it is not told; None where nobody asked.
        clip: address of the medoid's player.
        strength: root mean square of its eigenfailure [sigma]; noise has 1.
        proof: what its eigenfailure and its medoid did in the replays.
    """

    number: int
    failures: int
    share: str
    words: str
    probability: Figure | None
    medoid: int
    medoid_campaign: int
    strength: str
    clip: str
    proof: tuple[tuple[str, Figure], ...]


class AnalysisView(msgspec.Struct, frozen=True, kw_only=True):
    """The page of an analysis.

    Attributes:
        notes: what is to be known of the failures that were put together, or that they collapsed.
        proof: None before there is a result.
        asked: its settings, for another like it.
    """

    line: AnalysisLine
    campaign: int
    campaign_name: str
    is_open: bool
    verdict: str
    is_distinct: bool
    notes: tuple[str, ...]
    tiles: tuple[tuple[str, Figure], ...]
    modes: tuple[ModeCard, ...]
    grids: tuple[Grid, ...]
    charts: tuple[Chart, ...]
    proof: ProofView | None
    asked: AnalysisSettings


def analysis_view(analysis: Analysis, campaign: Campaign, proof: Proof | None) -> AnalysisView:
    """The page of an analysis, with the results of its replays as far as they are in."""
    result = analysis.result
    return AnalysisView(
        line=analysis_line(analysis),
        campaign=campaign.id,
        campaign_name=campaign.spec.name,
        is_open=analysis.state in {"queued", "running"} or replays(proof),
        verdict=result.verdict if result else "",
        is_distinct=result is not None and result.distinct,
        notes=tuple(notes(result)) if result else (),
        tiles=finding_tiles(result) if result else (),
        modes=mode_cards(result, campaign.id, proof) if result else (),
        grids=grids(result) if result else (),
        charts=charts(result, campaign.id) if result and result.modes else (),
        proof=proof_view(proof) if proof else None,
        asked=analysis.settings,
    )


def replays(proof: Proof | None) -> bool:
    """Whether there are replays that have not ended."""
    return proof is not None and bool(proof.scenarios) and not proof.done


def notes(result: AnalysisResult) -> Iterator[str]:
    """What is to be known beside the verdict."""
    yield from result.notes
    if result.diversity and result.diversity.warning:
        yield result.diversity.warning


def charts(result: AnalysisResult, campaign: int) -> tuple[Chart, ...]:
    """What was found, drawn."""
    return (
        eigenfailure_chart(result),
        scores_chart(result, campaign),
        explained_chart(result),
        influence_chart(result),
        *training_charts(result),
    )


def mode_cards(result: AnalysisResult, campaign: int, proof: Proof | None) -> tuple[ModeCard, ...]:
    """The modes, each with what was proven of it."""
    proven = {each.mode: each for each in proof.modes} if proof and proof.scenarios else {}
    return tuple(
        mode_card(place, result, campaign, proven.get(place)) for place in range(len(result.modes))
    )


def mode_card(
    place: int, result: AnalysisResult, campaign: int, proven: ProvenMode | None
) -> ModeCard:
    """One mode."""
    mode = result.modes[place]
    home = mode.medoid_campaign or campaign
    return ModeCard(
        number=place + 1,
        failures=mode.failures,
        share=formats.percent(mode.failures / len(result.episodes)),
        words=words(result, place),
        probability=probability(mode.probability),
        medoid=mode.medoid,
        medoid_campaign=home,
        clip=f"/campaigns/{home}/episodes/{mode.medoid}/clip",
        strength=formats.number(float(np.sqrt(np.mean(np.square(mode.eigenfailure))))),
        proof=proof_of(proven) if proven else (),
    )


def words(result: AnalysisResult, place: int) -> str:
    """What a mode is; its number stands above it already."""
    if not result.words:
        return f"Strongest noise: {peak(result.modes[place])}."
    return formats.signed(result.words[place].removeprefix(f"Mode {place + 1}: "))


def proof_of(proven: ProvenMode) -> tuple[tuple[str, Figure], ...]:
    """What a mode's two trajectories did in all scenarios."""
    return (
        ("Eigenfailure reproduced", tried(proven.eigenfailure)),
        ("Medoid reproduced", tried(proven.medoid)),
    )


def peak(mode: FailureMode) -> str:
    """The strongest noise of an eigenfailure: which way, how much, when."""
    z = mode.eigenfailure
    step, axis = np.unravel_index(int(np.abs(z).argmax()), z.shape)
    value = float(z[step, axis])
    ways = (("ahead", "back"), ("towards +y", "towards −y"))
    return f"{formats.number(abs(value), 2)} sigma {ways[axis][value < 0.0]} at step {step}"
