"""The page of an analysis: its modes, how sure they are, and when noise matters."""

from collections.abc import Iterator, Mapping, Sequence

import msgspec
import numpy as np
from fastapi import APIRouter
from fastapi.responses import HTMLResponse

from eigenfail import values
from eigenfail.contracts.recording import ANIMATION, list_formats
from eigenfail.presentation import analyses, figures
from eigenfail.presentation.tables import Table
from eigenfail.values.analysis import propose_mode_names
from eigenfail.values.triage import TriageState
from eigenfail.worlds import find_robustness_unit, world_of
from eigenfail_api.dashboard import episodes_page
from eigenfail_api.dashboard.analysis_charts import make_detail_charts, make_mode_charts
from eigenfail_api.dashboard.charts import Chart
from eigenfail_api.dashboard.proof import ProofView, describe_reproduction, make_proof_view
from eigenfail_api.dashboard.rendering import Tile, make_probability_tile, page
from eigenfail_api.parameters import AnalysisId, Stored
from eigenfail_services.campaigns.analysis_jobs import leaves_early_out
from eigenfail_services.campaigns.proofs import summarise_proof

Tiles = tuple[tuple[str, Tile], ...]


def make_diversity_tiles(found: values.Diversity) -> Tiles:
    """Return the tiles of how failures spread over modes that are distinct, each with its basis."""
    of_all = (f"of {figures.count_noun(found.failures, 'failure')}",)
    modes = f"of {figures.count_noun(found.modes, 'cluster')}, small ones included"
    return (
        ("Effective modes", Tile(figures.format_number(found.effective_modes), (modes,))),
        ("Largest mode", Tile(figures.format_share(found.largest_share), of_all)),
    )


def make_spread_tile(found: values.Diversity) -> Tile:
    """Return the tile of how much the noise of the failures differs."""
    return Tile(figures.format_number(found.spread), ("between failures; p(x) has 1",))


def make_coverage_tile(found: values.Diversity) -> Tile:
    """Return the tile of the share of the campaign after which no new mode was found."""
    seen = ", ".join(map(str, found.coverage))
    return Tile(describe_last_new_mode(found), (f"of those analysed, by tenths: {seen}",))


def describe_last_new_mode(found: values.Diversity) -> str:
    """Return the share of the campaign after which no new mode was found."""
    tenths = 1 + sum(seen < found.modes for seen in found.coverage)
    return f"{10 * tenths} %"


def make_finding_tiles(result: values.AnalysisResult, *, is_whole: bool = True) -> Tiles:
    """Return the tiles of an analysis's figures, each with its basis.

    Args:
        result: result of the analysis.
        is_whole: whether failures of the whole course were analysed. Where early ones are left out,
            the first tenths hold no mode by construction, and when modes were seen tells nothing.
    """
    found = result.diversity
    of_modes = found if result.distinct else None
    return (
        ("Failures analysed", count_failures(result)),
        ("Grouped by", Tile(result.features, (analyses.describe_grouping(result),))),
        ("Adjusted Rand index", make_stability_tile(result)),
        ("Variance explained", describe_variance(result)),
        *((("Near no mode", make_outlier_tile(result)),) if result.outliers else ()),
        *(make_diversity_tiles(of_modes) if of_modes else ()),
        *((("Spread [sigma]", make_spread_tile(found)),) if found else ()),
        *(
            (("All modes seen after", make_coverage_tile(of_modes)),)
            if of_modes and is_whole
            else ()
        ),
    )


def count_failures(result: values.AnalysisResult) -> Tile:
    """How many failures, of what."""
    count = figures.format_count(len(result.episodes))
    episodes = sum(source.episodes for source in result.sources)
    return Tile(count, (f"of {figures.count_noun(episodes, 'episode')}",) if episodes else ())


def make_stability_tile(result: values.AnalysisResult) -> Tile:
    """Return the tile of the modes' stability when failures are resampled."""
    found = result.stability
    if found is None:
        why = "no bootstrap" if len(result.modes) > 1 else "a single group"
        return Tile(figures.UNKNOWN, (f"not tried: {why}",))
    draws = f"{found.resamples} draws of {figures.count_noun(found.rows, 'failure')}"
    notes = (figures.format_interval(found.interval), draws, "1: the same groups; 0: chance")
    return Tile(figures.format_number(found.median), notes)


def describe_variance(result: values.AnalysisResult) -> Tile:
    """What the components keep."""
    by = figures.count_noun(len(result.explained), "component")
    return Tile(figures.format_share(float(np.sum(result.explained))), (f"by {by}",))


def make_outlier_tile(result: values.AnalysisResult) -> Tile:
    """Return the tile of failures that were assigned to the mode of their nearest neighbour."""
    return Tile(
        figures.format_share(result.outliers), ("assigned to the mode of their nearest neighbour",)
    )


def list_tables(result: values.AnalysisResult, step_s: float | None = None) -> tuple[Table, ...]:
    """Return the tables of noise within modes, moments, influence and sources that have rows.

    Args:
        result: result of the analysis.
        step_s: as `tabulate_noise_within` takes it. [s]
    """
    found = (
        analyses.tabulate_noise_within(result, step_s),
        analyses.tabulate_moments(result),
        analyses.tabulate_influence(result),
        analyses.tabulate_sources(result),
    )
    return tuple(grid for grid in found if grid.rows)


class ModeCard(msgspec.Struct, frozen=True, kw_only=True):
    """A failure mode; modes are counted from 1 for people.

    Attributes:
        words: what it is; of results of older releases its strongest noise.
        probability: probability of a failure of this mode, or why it has none; None where it was
            not requested.
        clip: address of the medoid's player.
        strength: root mean square of its eigenfailure [sigma]; noise has 1.
        proof: what its eigenfailure and its medoid did in the replays.
    """

    number: int
    failures: int
    share: str
    words: str
    probability: Tile | None
    medoid: int
    medoid_campaign: int
    strength: str
    clip: str
    proof: tuple[tuple[str, Tile], ...]


class AnalysisView(msgspec.Struct, frozen=True, kw_only=True):
    """The page of an analysis.

    Attributes:
        notes: remarks on the failures that were pooled, or that they collapsed.
        has_animations: whether an animation of the failures of each mode can be made here.
        proof: None before there is a result.
        asked: its settings, for another like it.
        is_doubtful: whether something speaks against distinct modes.
        choices: of the channels that the other one may analyse.
        names: the names that were given to modes, by number.
        triage: states of the modes that are not new, in words, by number.
    """

    line: episodes_page.AnalysisLine
    campaign: int
    campaign_name: str
    is_open: bool
    verdict: str
    is_distinct: bool
    is_doubtful: bool
    notes: tuple[str, ...]
    tiles: tuple[tuple[str, Tile], ...]
    modes: tuple[ModeCard, ...]
    grids: tuple[Table, ...]
    mode_charts: tuple[Chart, ...]
    detail_charts: tuple[Chart, ...]
    has_animations: bool
    proof: ProofView | None
    asked: values.AnalysisSettings
    choices: episodes_page.AnalysisChoices
    names: Mapping[int, str]
    triage: Mapping[int, str]


def make_analysis_view(
    analysis: values.Analysis,
    campaigns: Sequence[values.Campaign],
    proof: values.Proof | None,
    modes: Sequence[values.Mode],
) -> AnalysisView:
    """Return the page of an analysis, with the results of the replays that have ended.

    Args:
        analysis: the analysis.
        campaigns: the campaign that it is of, and those that it analyses with it.
        proof: the replays of its modes; None before there is a result.
        modes: its modes, with their names and triage.
    """
    result, campaign = analysis.result, campaigns[0]
    is_whole = not leaves_early_out(analysis.settings, campaigns)
    world = world_of(campaign.spec.simulator)
    channels, unit = world.channels(campaign.spec), find_robustness_unit(campaign.spec)
    step_s = world.step_s(campaign.spec) if analysis.settings.align == "collision" else None
    return AnalysisView(
        line=episodes_page.make_analysis_line(analysis, channels),
        campaign=campaign.id,
        campaign_name=campaign.spec.name,
        is_open=analysis.state in {"queued", "running"} or is_replaying(proof),
        verdict=f"{result.verdict} {result.caution}".rstrip() if result else "",
        is_distinct=result is not None and result.distinct,
        is_doubtful=result is None or not result.distinct or bool(result.caution),
        notes=tuple(list_notes(result)) if result else (),
        tiles=make_finding_tiles(result, is_whole=is_whole) if result else (),
        modes=make_mode_cards(result, campaign.id, proof, unit) if result else (),
        grids=list_tables(result, step_s) if result else (),
        mode_charts=make_mode_charts(result, campaign.id) if result and result.modes else (),
        detail_charts=make_detail_charts(result) if result and result.modes else (),
        has_animations=world.has_road and ANIMATION in list_formats(),
        proof=make_proof_view(proof, unit) if proof else None,
        asked=analysis.settings,
        choices=episodes_page.list_analysis_choices(campaign.spec),
        names=find_given_names(result, modes) if result else {},
        triage={
            mode.number: mode.state.words for mode in modes if mode.state is not TriageState.NEW
        },
    )


def find_given_names(result: values.AnalysisResult, modes: Sequence[values.Mode]) -> dict[int, str]:
    """Return the names that were given to modes by number, without those that are proposed."""
    proposed = propose_mode_names(result.words or ("",) * len(result.modes))
    return {mode.number: mode.name for mode in modes if mode.name != proposed[mode.number - 1]}


def is_replaying(proof: values.Proof | None) -> bool:
    """Whether the proof has replays that have not ended."""
    return proof is not None and bool(proof.scenarios) and not proof.done


def list_notes(result: values.AnalysisResult) -> Iterator[str]:
    """Return the remarks below the verdict."""
    yield from result.notes
    if result.diversity and result.diversity.collapse:
        yield result.diversity.collapse


def make_mode_cards(
    result: values.AnalysisResult, campaign: int, proof: values.Proof | None, unit: str
) -> tuple[ModeCard, ...]:
    """Return a card for each mode, with the result of its proof; robustness in a unit, or none."""
    proven = {each.mode: each for each in proof.modes} if proof and proof.scenarios else {}
    tiles = {mode: make_proof_tiles(each, unit) for mode, each in proven.items()}
    return tuple(
        make_mode_card(place, result, campaign, tiles.get(place, ()))
        for place in range(len(result.modes))
    )


def make_mode_card(
    place: int, result: values.AnalysisResult, campaign: int, proof: tuple[tuple[str, Tile], ...]
) -> ModeCard:
    """Return the card of a mode, with the tiles of its proof."""
    mode = result.modes[place]
    home = mode.medoid_campaign or campaign
    return ModeCard(
        number=place + 1,
        failures=mode.failures,
        share=figures.format_share(mode.failures / len(result.episodes)),
        words=describe_mode_card(result, place),
        probability=make_probability_tile(mode.probability),
        medoid=mode.medoid,
        medoid_campaign=home,
        clip=f"/campaigns/{home}/episodes/{mode.medoid}/clip",
        strength=figures.format_number(float(np.sqrt(np.mean(np.square(mode.eigenfailure))))),
        proof=proof,
    )


def describe_mode_card(result: values.AnalysisResult, place: int) -> str:
    """Return the description of a mode without its number, which the card's heading has."""
    if not result.words:
        return f"Strongest noise: {describe_peak(result.modes[place], result.channels)}."
    return figures.put_minus_signs(result.words[place].removeprefix(f"Mode {place + 1}: "))


def make_proof_tiles(proven: values.ProvenMode, unit: str) -> tuple[tuple[str, Tile], ...]:
    """Return the tiles of the replays of a mode's two trajectories in all scenarios."""
    tiles = (
        ("Eigenfailure reproduced", describe_reproduction(proven.eigenfailure, unit)),
        ("Medoid reproduced", describe_reproduction(proven.medoid, unit)),
    )
    if proven.nearest is None:
        return tiles
    place, _, words = proven.nearest.words.partition(": ")
    nearest = Tile(f"t = {figures.format_number(proven.nearest.t)}", (words or place,))
    return (*tiles, ("Nearest failing point", nearest))


WAYS = {"longitudinal": ("ahead", "back"), "lateral": ("towards +y", "towards −y")}
"""Of positive and of negative noise of a position."""


def describe_peak(mode: values.FailureMode, channels: Sequence[str]) -> str:
    """Return the channel, strength and time of an eigenfailure's strongest noise."""
    z = mode.eigenfailure
    step, way = np.unravel_index(int(np.abs(z).argmax()), z.shape)
    value, channel = float(z[step, way]), channels[int(way)]
    signs = WAYS.get(channel, (f"of positive {channel}", f"of negative {channel}"))
    return f"{figures.format_number(abs(value), 2)} sigma {signs[value < 0.0]} at step {step}"


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)


@router.get("/analyses/{analysis}")
def show_analysis(store: Stored, analysis: AnalysisId) -> HTMLResponse:
    """One analysis."""
    seen = store.analyses.get(analysis)
    proven = summarise_proof(store, seen) if seen.result else None
    # Only an analysis with a result is known to name campaigns that exist.
    others = seen.settings.campaigns if seen.result else ()
    campaigns = list(map(store.campaigns.get, (seen.campaign, *others)))
    modes = store.analyses.modes(analysis)
    return page("analysis.html", make_analysis_view(seen, campaigns, proven, modes))
