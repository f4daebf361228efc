"""The page of an analysis: its modes, how sure they are, and when noise matters."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import msgspec
import numpy as np
from fastapi import APIRouter
from fastapi.responses import HTMLResponse

from eigenfail.contracts.recording import ANIMATION, list_formats
from eigenfail.presentation import analyses, figures
from eigenfail.presentation.tables import FormattedCell, Table
from eigenfail.values.analysis import (
    JOINT,
    Analysis,
    AnalysisResult,
    AnalysisSettings,
    Diversity,
    FailureMode,
    Mode,
)
from eigenfail.values.campaign import Campaign, CampaignState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import ERRORED, Outcome
from eigenfail.values.proof import Proof, ProvenMode, ProvenScenario
from eigenfail.values.triage import TriageState
from eigenfail.worlds import find_robustness_unit, world_of
from eigenfail_api.dashboard import rendering
from eigenfail_api.dashboard.analysis_charts import make_detail_charts, make_mode_charts
from eigenfail_api.parameters import AnalysisId, Stored
from eigenfail_services.campaigns.analysis_jobs import leaves_early_out
from eigenfail_services.campaigns.proofs import CAME_TO_NOTHING, summarise_proof


class AnalysisChoices(msgspec.Struct, frozen=True):
    """The choices for analyses of a campaign.

    Attributes:
        label: the label of the choice of channels.
        options: the channels, each with its words.
        alignments: where failures may be aligned, each with its words.
    """

    label: str
    options: Mapping[str, str]
    alignments: Mapping[str, str]


def list_analysis_choices(spec: CampaignSpec) -> AnalysisChoices:
    """Return the choices for analyses of a campaign."""
    world = world_of(spec.simulator)
    channels = world.channels(spec)
    words = analyses.choose_channel_words(channels)
    axes = {JOINT: words.together, **{channel: f"{channel} only" for channel in channels}}
    collides = world.has_road and spec.fails_by_collision_alone
    alignments = {"start": "start"} | ({"collision": "collision"} if collides else {})
    return AnalysisChoices(words.several.capitalize(), axes, alignments)


def describe_settings(settings: AnalysisSettings, channels: Sequence[str]) -> Iterator[str]:
    """Yield how failures are analysed, in words."""
    words = analyses.choose_channel_words(channels)
    together = f"{words.together} {words.several}"
    yield f"aligned at {settings.align}"
    yield together if settings.axes == JOINT else f"the {settings.axes} {words.one} alone"
    yield figures.count_noun(settings.components, "component")
    yield rendering.CLUSTERERS[settings.clusterer]
    yield "modes: auto" if settings.clusters is None else f"modes: {settings.clusters}"
    yield f"bootstrap {settings.bootstrap}" if settings.bootstrap else "no bootstrap"
    yield f"failures: {settings.failures}"
    yield f"eigenfailures: {settings.centre}"
    yield f"features: {settings.features}"
    if settings.campaigns:
        yield f"with campaigns {', '.join(map(str, settings.campaigns))}"


def make_diversity_tiles(found: Diversity) -> rendering.Tiles:
    """Return the tiles of how failures spread over modes that are distinct, each with its basis."""
    of_all = (f"of {figures.count_noun(found.failures, 'failure')}",)
    modes = f"of {figures.count_noun(found.modes, 'cluster')}, small ones included"
    return (
        ("Effective modes", rendering.Tile(found.effective_modes, (modes,))),
        ("Largest mode", rendering.Tile(found.largest_share, of_all, unit="share")),
    )


def make_coverage_tile(found: Diversity) -> rendering.Tile:
    """Return the tile of the share of the campaign after which no new mode was found."""
    seen = ", ".join(map(str, found.coverage))
    tenths = 1 + sum(each < found.modes for each in found.coverage)
    return rendering.Tile(f"{10 * tenths} %", (f"of those analysed, by tenths: {seen}",))


def make_finding_tiles(result: AnalysisResult, *, is_whole: bool = True) -> rendering.Tiles:
    """Return the tiles of an analysis's figures, each with its basis.

    Args:
        result: result of the analysis.
        is_whole: whether failures of the whole course were analysed. If early failures are left
            out, the first tenths contain no modes by construction. The tile that shows when all
            modes were seen would then be meaningless.
    """
    found = result.diversity
    # Figures of modes would call groups of failures modes.
    of_modes = found if result.distinct else None
    episodes = sum(source.episodes for source in result.sources)
    of_all = (f"of {figures.count_noun(episodes, 'episode')}",) if episodes else ()
    components = figures.count_noun(len(result.explained), "component")
    explained = float(np.sum(result.explained))
    tiles: list[rendering.NamedTile] = [
        ("Failures analysed", rendering.Tile(len(result.episodes), of_all)),
        ("Grouped by", rendering.Tile(result.features, (analyses.describe_grouping(result),))),
        ("Adjusted Rand index", make_stability_tile(result)),
        ("Variance explained", rendering.Tile(explained, (f"by {components}",), unit="share")),
    ]
    if result.outliers:
        nearest = ("assigned to the mode of their nearest neighbour",)
        tiles.append(("Near no mode", rendering.Tile(result.outliers, nearest, unit="share")))
    if of_modes:
        tiles += make_diversity_tiles(of_modes)
    if found:
        of_prior = ("between failures; p(x) has 1",)
        tiles.append(("Spread [sigma]", rendering.Tile(found.spread, of_prior)))
    if of_modes and is_whole:
        tiles.append(("All modes seen after", make_coverage_tile(of_modes)))
    return tuple(tiles)


def make_stability_tile(result: AnalysisResult) -> rendering.Tile:
    """Return the tile of the modes' stability when failures are resampled."""
    found = result.stability
    if found is None:
        why = "no bootstrap" if len(result.modes) > 1 else "a single group"
        return rendering.Tile(None, (f"not tried: {why}",))
    draws = f"{found.resamples} draws of {figures.count_noun(found.rows, 'failure')}"
    notes = (figures.format_interval(found.interval), draws, "1: the same groups; 0: chance")
    return rendering.Tile(found.median, notes)


def list_tables(result: AnalysisResult, step_s: float | None = None) -> tuple[Table, ...]:
    """Return the tables of noise within modes, moments, influence and sources that have rows.

    Args:
        result: result of the analysis.
        step_s: as `tabulate_noise_within` takes it. [s]
    """
    found = (
        analyses.tabulate_noise_within(result, step_s),
        analyses.tabulate_moments(result),
        analyses.tabulate_last_influence(result),
        analyses.tabulate_sources(result),
    )
    return tuple(grid for grid in found if grid.rows)


class ModeCard(msgspec.Struct, frozen=True, kw_only=True):
    """A failure mode as pages show it; modes are counted from 1 for people.

    Attributes:
        mode: the mode, as the analysis found it.
        share: its share of the failures that were analysed.
        words: description of the mode, without its number, which the page shows above.
        medoid_campaign: campaign of its medoid.
        clip: address of the medoid's player.
        strength: root mean square of its eigenfailure [sigma]; noise has 1.
        proof: what its eigenfailure and its medoid did in the replays.
    """

    number: int
    mode: FailureMode
    share: float
    words: str
    medoid_campaign: int
    clip: str
    strength: float
    proof: rendering.Tiles


def make_analysis_view(
    analysis: Analysis,
    campaigns: Sequence[Campaign],
    proof: Proof | None,
    modes: Sequence[Mode],
) -> dict[str, object]:
    """Return what the page of an analysis shows, with the results of the replays that have ended.

    Args:
        analysis: the analysis.
        campaigns: the campaign of the analysis, and the campaigns that are analysed with it.
        proof: the replays of its modes; None before there is a result.
        modes: its modes, with their names and triage.
    """
    result, campaign = analysis.result, campaigns[0]
    world = world_of(campaign.spec.simulator)
    words = ", ".join(describe_settings(analysis.settings, campaign.form.channels))
    is_replaying = proof is not None and bool(proof.scenarios) and not proof.done
    view: dict[str, object] = {
        "analysis": analysis,
        "settings": words[0].upper() + words[1:],
        "campaign": campaign,
        "is_open": analysis.state in {"queued", "running"} or is_replaying,
        "choices": list_analysis_choices(campaign.spec),
    }
    if result is None or proof is None:
        return view
    unit = find_robustness_unit(campaign.spec)
    collapse = result.diversity.collapse if result.diversity else ""
    step_s = campaign.form.step_s if analysis.settings.align == "collision" else None
    is_whole = not leaves_early_out(analysis.settings, campaigns)
    proposed = result.list_modes(analysis.id)
    return view | {
        "result": result,
        # Something speaks against distinct modes.
        "is_doubtful": not result.distinct or bool(result.caution),
        "notes": (*result.notes, *([collapse] if collapse else [])),
        "tiles": make_finding_tiles(result, is_whole=is_whole),
        "modes": make_mode_cards(result, campaign.id, proof, unit),
        "grids": list_tables(result, step_s),
        "mode_charts": make_mode_charts(result, campaign.id) if result.modes else (),
        "detail_charts": make_detail_charts(result) if result.modes else (),
        "has_animations": world.has_road and ANIMATION in list_formats(),
        "proof": make_proof_view(proof, unit),
        # Proposed names repeat the words of the card.
        "given_names": {
            mode.number: mode.name
            for mode, unnamed in zip(modes, proposed, strict=True)
            if mode.name != unnamed.name
        },
        "triage": {
            mode.number: mode.state.words for mode in modes if mode.state is not TriageState.NEW
        },
    }


def make_mode_cards(
    result: AnalysisResult, campaign: int, proof: Proof, unit: str
) -> tuple[ModeCard, ...]:
    """Return a card for each mode, with the result of its proof; robustness in a unit, or none."""
    # Before anything was replayed, tiles of zero of zero would look like a result.
    proven = {each.mode: each for each in proof.modes} if proof.scenarios else {}
    described = zip(result.modes, result.words or [""] * len(result.modes), strict=True)
    return tuple(
        ModeCard(
            number=place + 1,
            mode=mode,
            share=mode.failures / len(result.episodes),
            words=figures.put_minus_signs(words.removeprefix(f"Mode {place + 1}: ")),
            medoid_campaign=mode.medoid_campaign or campaign,
            clip=f"/campaigns/{mode.medoid_campaign or campaign}/episodes/{mode.medoid}/clip",
            strength=float(np.sqrt(np.mean(np.square(mode.typical)))),
            proof=make_proof_tiles(proven[place], unit) if place in proven else (),
        )
        for place, (mode, words) in enumerate(described)
    )


def make_proof_tiles(proven: ProvenMode, unit: str) -> rendering.Tiles:
    """Return the tiles of the replays of a mode's two trajectories in all scenarios."""
    tiles: list[rendering.NamedTile] = [
        ("Eigenfailure reproduced", analyses.format_reproduction(proven.eigenfailure, unit)),
        ("Medoid reproduced", analyses.format_reproduction(proven.medoid, unit)),
    ]
    if nearest := proven.nearest:
        place, _, words = nearest.words.partition(": ")
        t = f"t = {figures.format_number(nearest.t)}"
        tiles.append(("Nearest failing point", FormattedCell(t, sample=words or place)))
    return tuple(tiles)


def make_proof_view(found: Proof, unit: str) -> dict[str, object]:
    """Return what the page shows of an analysis's replays; robustness in a unit, or none."""
    replays = [replay for scenario in found.scenarios for replay in scenario.replays]
    cut_off = any(scenario.state in CAME_TO_NOTHING for scenario in found.scenarios)
    tallies, count = {"Eigenfailures, same scenario": found.reproduced}, len(found.scenarios)
    # With one scenario both counts would be the same.
    if count > 1:
        tallies[f"Eigenfailures, {count} scenarios"] = found.eigenfailures
    tallies[f"Medoids, {count} scenarios" if count > 1 else "Medoids"] = found.medoids
    return {
        "found": found,
        "unit": unit,
        "ended": sum(replay.outcome is not None for replay in replays),
        "planned": len(replays),
        # Asking replays something only where nothing was replayed, some of it was cut off, or
        # centres do not fail.
        "may_ask": not found.scenarios or cut_off or bool(found.done and found.unplaced),
        "tallies": [
            (name, analyses.format_reproduction(each, unit)) for name, each in tallies.items()
        ],
        "describe": partial(analyses.format_reproduction, unit=unit),
        "badge_of": make_scenario_badge,
        "outcomes": rendering.OUTCOME_BADGES,
    }


def make_scenario_badge(scenario: ProvenScenario) -> rendering.Badge:
    """Return the badge of the campaign that replays: errored if every replay of it errored."""
    ended = [replay.outcome for replay in scenario.replays if replay.outcome is not None]
    is_errored = bool(ended) and all(outcome is Outcome.ERRORED for outcome in ended)
    is_done = scenario.state is CampaignState.DONE
    return rendering.CAMPAIGN_BADGES[ERRORED if is_done and is_errored else scenario.state]


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)


@router.get("/analyses/{analysis}")
def show_analysis(store: Stored, analysis: AnalysisId) -> HTMLResponse:
    """Show an analysis."""
    seen = store.analyses.get(analysis)
    proven = summarise_proof(store, seen) if seen.result else None
    # Only an analysis with a result is known to name campaigns that exist.
    others = seen.settings.campaigns if seen.result else ()
    campaigns = list(map(store.campaigns.get, (seen.campaign, *others)))
    modes = store.analyses.modes(analysis)
    view = make_analysis_view(seen, campaigns, proven, modes)
    return rendering.page("analysis.html", view)
