"""The page of an analysis: its modes, how sure they are, and when noise matters."""

from collections.abc import Callable, Iterable, Iterator, Sequence

import msgspec
import numpy as np
from fastapi import APIRouter
from fastapi.responses import HTMLResponse

from eigenfail.exchange import list_formats
from eigenfail.exchange.recording import RecordingFormat
from eigenfail.presentation.analyses import (
    describe_grouping,
    tabulate_influence,
    tabulate_moments,
    tabulate_noise_within,
    tabulate_sources,
)
from eigenfail.presentation.figures import (
    UNKNOWN,
    count_noun,
    format_count,
    format_interval,
    format_number,
    format_share,
    put_minus_signs,
)
from eigenfail.presentation.tables import Table
from eigenfail.values import (
    Analysis,
    AnalysisResult,
    AnalysisSettings,
    Behaviour,
    Campaign,
    Diversity,
    FailureMode,
    Floats,
    Moment,
    Proof,
    ProvenMode,
    TrainingInterval,
)
from eigenfail.worlds import find_robustness_unit, world_of
from eigenfail_api.dashboard.charts import MOST_ROWS, Chart, round_rows, round_values
from eigenfail_api.dashboard.episodes_page import (
    AnalysisChoices,
    AnalysisLine,
    list_analysis_choices,
    make_analysis_line,
)
from eigenfail_api.dashboard.proof import ProofView, describe_reproduction, make_proof_view
from eigenfail_api.dashboard.rendering import Tile, make_probability_tile, page
from eigenfail_api.parameters import AnalysisId, Stored
from eigenfail_services.campaigns.proofs import summarise_proof

MOST_POINTS = 5_000


def make_behaviour_charts(behaviour: Behaviour | None) -> tuple[Chart, ...]:
    """Return the chart of the ego's acceleration in each mode; none where it is not known."""
    if behaviour is None:
        return ()
    event = "collision" if behaviour.origin == "collision" else "start"
    chart = Chart(
        id="behaviour-chart",
        kind="behaviour",
        title="Acceleration of the ego",
        caption=f"What the ego did in each mode, by the time from the {event} [m/s²]. Thick: the "
        "mean of its failures. Thin: some of them.",
        data={
            "event": event,
            "times": list_floats(behaviour.times_s),
            "modes": [
                {"mean": list_floats(mode.mean), "members": round_rows(mode.members)}
                for mode in behaviour.modes
            ],
        },
        columns=(
            f"Time from the {event} [s]",
            *(f"Mode {place + 1}" for place in range(len(behaviour.modes))),
        ),
        rows=tuple(
            (format_number(float(time_s)), *(format_number(float(value)) for value in values))
            for time_s, *values in zip(
                behaviour.times_s, *(mode.mean for mode in behaviour.modes), strict=True
            )
        ),
    )
    return (chart,)


def make_eigenfailure_chart(result: AnalysisResult) -> Chart:
    """Return the chart of each mode's eigenfailure with its band."""
    modes = [mode.eigenfailure for mode in result.modes]
    bands = [mode.band for mode in result.modes if mode.band is not None]
    channels = result.channels
    return Chart(
        id="eigenfailure-chart",
        kind="eigenfailures",
        title="Eigenfailures",
        caption="Centre of the noise of each mode over time [sigma]."
        + (" Bands: from 10 to 90 % of the noise of its failures at each step." if bands else ""),
        data={
            "channels": {
                channel: [list_floats(z[:, way]) for z in modes]
                for way, channel in enumerate(channels)
            },
            "bands": {
                channel: list_band_limits(bands, way) for way, channel in enumerate(channels)
            },
        },
        columns=(
            "Step",
            *(f"Mode {mode + 1} {channel}" for mode in range(len(modes)) for channel in channels),
            *name_band_columns(len(bands), channels),
        ),
        rows=make_step_table(
            np.concatenate([*modes, *(side for band in bands for side in band)], axis=1)
        ),
    )


def list_band_limits(bands: Iterable[Floats], way: int) -> list[list[list[float | None]]]:
    """Return the lower and the upper limit of each mode's band in a channel."""
    return [[list_floats(side[:, way]) for side in band] for band in bands]


def name_band_columns(count: int, channels: Sequence[str]) -> Iterator[str]:
    """Names of the columns of bands, in the order of their numbers."""
    for mode in range(count):
        for share in ("10 %", "90 %"):
            yield from (f"Mode {mode + 1} {channel} {share}" for channel in channels)


def make_scores_chart(result: AnalysisResult, campaign: int) -> Chart:
    """Return the chart of failures in PCA space, of `campaign` unless the result names others."""
    chosen = pick_evenly(len(result.episodes), MOST_POINTS)
    second = 1 if result.scores.shape[1] > 1 else 0
    centres = np.stack([mode.centre for mode in result.modes])
    addresses = list_episode_names(result, campaign)
    return Chart(
        id="scores-chart",
        kind="scores",
        title="Failures in PCA space",
        caption="Each failure by the first two scores of its noise; colour and shape show the "
        "mode, + its mean.",
        data={
            "episode": [addresses[row] for row in chosen],
            "mode": [result.labels[row] for row in chosen],
            "x": list_floats(result.scores[chosen, 0]),
            "y": list_floats(result.scores[chosen, second]),
            "centres": [list_floats(centre[[0, second]]) for centre in centres],
        },
        columns=("Episode", "Mode", "First score", "Second score"),
        rows=tuple(
            (
                addresses[row],
                str(result.labels[row] + 1),
                format_number(float(result.scores[row, 0])),
                format_number(float(result.scores[row, second])),
            )
            for row in chosen[:MOST_ROWS]
        ),
        note=f"The first {MOST_ROWS}." if len(chosen) > MOST_ROWS else "",
    )


def make_explained_chart(result: AnalysisResult) -> Chart:
    """Return the chart of the variance that each component explains."""
    cumulated = np.cumsum(result.explained)
    return Chart(
        id="explained-chart",
        kind="explained",
        title="Explained variance",
        caption="Share of the variance by component, and cumulative.",
        data={
            "share": list_floats(100.0 * result.explained),
            "cumulated": list_floats(100.0 * cumulated),
        },
        columns=("Component", "Share", "Cumulated"),
        rows=tuple(
            (str(place + 1), format_share(float(share)), format_share(float(so_far)))
            for place, (share, so_far) in enumerate(zip(result.explained, cumulated, strict=True))
        ),
    )


def make_influence_chart(result: AnalysisResult) -> Chart:
    """Return the chart of the influence of noise over time."""
    return Chart(
        id="influence-chart",
        kind="influence",
        title="Influence over time",
        caption="Where the noise of the failures differs, which is no cause: components weighted "
        "by explained variance. Marks: the moments of greatest influence.",
        data={
            "channels": {
                channel: list_floats(result.influence[:, way])
                for way, channel in enumerate(result.channels)
            },
            "moments": [draw_moment(each) for each in result.moments],
        },
        columns=("Step", *map(str.capitalize, result.channels)),
        rows=make_step_table(result.influence),
    )


def draw_moment(found: Moment) -> dict[str, object]:
    """Return the JSON that the page's chart draws for a moment."""
    before_s = found.before_collision_s
    text = "" if before_s is None else f"{format_number(before_s)} s before the collision"
    return {"axis": found.axis, "step": found.step, "time": text}


def list_episode_names(result: AnalysisResult, campaign: int) -> list[str]:
    """Return each failure's name, "campaign/episode"."""
    owners = result.campaigns or (campaign,) * len(result.episodes)
    return [f"{owner}/{index}" for owner, index in zip(owners, result.episodes, strict=True)]


def make_step_table(columns: Floats) -> tuple[tuple[str, ...], ...]:
    """Return the rows of a table with one row for each step."""
    return tuple(
        (str(step), *(format_number(float(value)) for value in row))
        for step, row in enumerate(columns)
    )


def pick_evenly(count: int, most: int) -> list[int]:
    """Return at most `most` of `count` positions, spread evenly."""
    taken = min(count, most)
    return [place * count // taken for place in range(taken)] if taken else []


def list_floats(values: Iterable[np.floating]) -> list[float | None]:
    """Return an array as plain floats; None for values that are not finite."""
    return round_values(float(value) for value in values)


def make_diversity_tiles(found: Diversity) -> tuple[tuple[str, Tile], ...]:
    """Return the tiles of the diversity figures, each with its basis."""
    of_all = (f"of {count_noun(found.failures, 'failure')}",)
    modes = f"of {found.modes}, clusters beyond noise"
    seen = ", ".join(map(str, found.coverage))
    return (
        ("Effective modes", Tile(format_number(found.effective_modes), (modes,))),
        ("Largest mode", Tile(format_share(found.largest_share), of_all)),
        ("Spread [sigma]", Tile(format_number(found.spread), ("between failures; p(x) has 1",))),
        (
            "All modes seen after",
            Tile(
                describe_last_new_mode(found),
                (f"of those analysed, by tenths: {seen}",),
            ),
        ),
    )


def describe_last_new_mode(found: Diversity) -> str:
    """Return the share of the campaign after which no new mode was found."""
    tenths = 1 + sum(seen < found.modes for seen in found.coverage)
    return f"{10 * tenths} %"


Tiles = tuple[tuple[str, Tile], ...]


def make_finding_tiles(result: AnalysisResult) -> Tiles:
    """Return the tiles of an analysis's figures, each with its basis."""
    return (
        ("Failures analysed", count_failures(result)),
        ("Grouped by", Tile(result.features, (describe_grouping(result),))),
        ("Adjusted Rand index", make_stability_tile(result)),
        ("Variance explained", describe_variance(result)),
        *((("Near no mode", make_outlier_tile(result)),) if result.outliers else ()),
        *(make_diversity_tiles(result.diversity) if result.diversity else ()),
    )


def count_failures(result: AnalysisResult) -> Tile:
    """How many failures, of what."""
    count = format_count(len(result.episodes))
    episodes = sum(source.episodes for source in result.sources)
    return Tile(count, (f"of {count_noun(episodes, 'episode')}",) if episodes else ())


def make_stability_tile(result: AnalysisResult) -> Tile:
    """Return the tile of the modes' stability when failures are resampled."""
    found = result.stability
    if found is None:
        why = "no bootstrap" if len(result.modes) > 1 else "a single group"
        return Tile(UNKNOWN, (f"not tried: {why}",))
    draws = f"{found.resamples} draws of {count_noun(found.rows, 'failure')}"
    notes = (format_interval(found.interval), draws, "1: the same groups; 0: chance")
    return Tile(format_number(found.median), notes)


def describe_variance(result: AnalysisResult) -> Tile:
    """What the components keep."""
    by = count_noun(len(result.explained), "component")
    return Tile(format_share(float(np.sum(result.explained))), (f"by {by}",))


def make_outlier_tile(result: AnalysisResult) -> Tile:
    """Return the tile of failures that were assigned to the mode of their nearest neighbour."""
    return Tile(format_share(result.outliers), ("assigned to the mode of their nearest neighbour",))


def list_tables(result: AnalysisResult, step_s: float | None = None) -> tuple[Table, ...]:
    """Return the tables of noise within modes, moments, influence and sources that have rows.

    Args:
        result: result of the analysis.
        step_s: as `tabulate_noise_within` takes it. [s]
    """
    found = (
        tabulate_noise_within(result, step_s),
        tabulate_moments(result),
        tabulate_influence(result),
        tabulate_sources(result),
    )
    return tuple(grid for grid in found if grid.rows)


MOST_STEPS = 200
"""Points of a line: more cannot be distinguished on a screen."""

DIGITS = 3

Lines = Callable[[TrainingInterval], Iterable[Floats]]


def make_training_charts(result: AnalysisResult) -> tuple[Chart, ...]:
    """Return the charts over the training; none for results of older releases."""
    if not result.training:
        return ()
    return (
        make_mean_chart(result.training, result.channels),
        make_component_chart(result.training, result.channels),
    )


def make_mean_chart(intervals: Sequence[TrainingInterval], channels: Sequence[str]) -> Chart:
    """Return the chart of the mean disturbance of the failures."""
    return Chart(
        id="training-mean-chart",
        kind="training",
        title="Mean disturbance during the search",
        caption="Mean noise of the failures of each tenth of the episodes, over their steps "
        "[sigma]: the first tenth on top.",
        data=make_ridges(
            intervals, channels, ("mean",), lambda interval: [interval.mean], unit="sigma"
        ),
        columns=(
            "Step",
            *(f"{channel} {format_span(each)}" for channel in channels for each in intervals),
        ),
        rows=make_step_table(
            np.concatenate(
                [each.mean[:, [way]] for way in range(len(channels)) for each in intervals], axis=1
            )
        ),
    )


def make_component_chart(intervals: Sequence[TrainingInterval], channels: Sequence[str]) -> Chart:
    """Return the chart of the components of each interval."""
    count = max(len(each.components) for each in intervals)
    return Chart(
        id="training-components-chart",
        kind="training",
        title="Components during the search",
        caption="The first components of the failures of each tenth alone, turned towards those "
        "of all; the legend shows the others. Likeness is |cosine| with the component of all "
        "failures: 1 is the same.",
        data=make_ridges(
            intervals,
            channels,
            tuple(f"component {place + 1}" for place in range(count)),
            lambda interval: interval.components,
            unit="",
        ),
        columns=("Episodes", "Failures", "Component", "Explained", "Likeness"),
        rows=tuple(row for each in intervals for row in list_component_rows(each)),
        note="By interval; single steps are in the API.",
    )


def list_component_rows(interval: TrainingInterval) -> list[tuple[str, ...]]:
    """Return a row for each component; with dashes for a missing component."""
    head = (format_span(interval), format_count(interval.failures))
    rows: list[tuple[str, ...]] = [
        (*head, str(place), format_share(float(share)), format_number(float(likeness)))
        for place, (share, likeness) in enumerate(
            zip(interval.explained, interval.likeness, strict=True), start=1
        )
    ]
    return rows or [(*head, *[UNKNOWN] * 3)]


def make_ridges(
    intervals: Sequence[TrainingInterval],
    channels: Sequence[str],
    names: tuple[str, ...],
    lines: Lines,
    *,
    unit: str,
) -> dict[str, object]:
    """Return the lines [unit] by channel, interval and name; an interval may have no failures."""
    steps = pick_evenly(len(intervals[0].mean), MOST_STEPS)
    return {
        "names": names,
        "unit": unit,
        "spans": [format_span(each) for each in intervals],
        "steps": steps,
        "channels": {
            channel: [
                [round_ridge_values(line[steps, way]) for line in lines(each)]
                if each.failures
                else []
                for each in intervals
            ]
            for way, channel in enumerate(channels)
        },
    }


def round_ridge_values(values: Floats) -> list[float]:
    """Return the values with as many digits as a chart can show."""
    return [float(f"{value:.{DIGITS}g}") for value in np.asarray(values, np.float64)]


def format_span(interval: TrainingInterval) -> str:
    """Return the first and the last episode of an interval as text."""
    return f"{100.0 * interval.start:.0f} – {100.0 * interval.end:.0f} %"


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
        choices: of the channels that the other one may analyse.
    """

    line: AnalysisLine
    campaign: int
    campaign_name: str
    is_open: bool
    verdict: str
    is_distinct: bool
    notes: tuple[str, ...]
    tiles: tuple[tuple[str, Tile], ...]
    modes: tuple[ModeCard, ...]
    grids: tuple[Table, ...]
    charts: tuple[Chart, ...]
    has_animations: bool
    proof: ProofView | None
    asked: AnalysisSettings
    choices: AnalysisChoices


def make_analysis_view(analysis: Analysis, campaign: Campaign, proof: Proof | None) -> AnalysisView:
    """Return the page of an analysis, with the results of the replays that have ended."""
    result = analysis.result
    world = world_of(campaign.spec.simulator)
    channels, unit = world.channels(campaign.spec), find_robustness_unit(campaign.spec)
    step_s = world.step_s(campaign.spec) if analysis.settings.align == "collision" else None
    return AnalysisView(
        line=make_analysis_line(analysis, channels),
        campaign=campaign.id,
        campaign_name=campaign.spec.name,
        is_open=analysis.state in {"queued", "running"} or is_replaying(proof),
        verdict=result.verdict if result else "",
        is_distinct=result is not None and result.distinct,
        notes=tuple(list_notes(result)) if result else (),
        tiles=make_finding_tiles(result) if result else (),
        modes=make_mode_cards(result, campaign.id, proof, unit) if result else (),
        grids=list_tables(result, step_s) if result else (),
        charts=make_charts(result, campaign.id) if result and result.modes else (),
        has_animations=world.has_road and RecordingFormat.GIF in list_formats(),
        proof=make_proof_view(proof, unit) if proof else None,
        asked=analysis.settings,
        choices=list_analysis_choices(campaign.spec),
    )


def is_replaying(proof: Proof | None) -> bool:
    """Whether the proof has replays that have not ended."""
    return proof is not None and bool(proof.scenarios) and not proof.done


def list_notes(result: AnalysisResult) -> Iterator[str]:
    """Return the remarks below the verdict."""
    yield from result.notes
    if result.diversity and result.diversity.warning:
        yield result.diversity.warning


def make_charts(result: AnalysisResult, campaign: int) -> tuple[Chart, ...]:
    """Return the charts of an analysis."""
    return (
        *make_behaviour_charts(result.behaviour),
        make_eigenfailure_chart(result),
        make_scores_chart(result, campaign),
        make_explained_chart(result),
        make_influence_chart(result),
        *make_training_charts(result),
    )


def make_mode_cards(
    result: AnalysisResult, campaign: int, proof: Proof | None, unit: str
) -> tuple[ModeCard, ...]:
    """Return a card for each mode, with the result of its proof; robustness in a unit, or none."""
    proven = {each.mode: each for each in proof.modes} if proof and proof.scenarios else {}
    tiles = {mode: make_proof_tiles(each, unit) for mode, each in proven.items()}
    return tuple(
        make_mode_card(place, result, campaign, tiles.get(place, ()))
        for place in range(len(result.modes))
    )


def make_mode_card(
    place: int, result: AnalysisResult, campaign: int, proof: tuple[tuple[str, Tile], ...]
) -> ModeCard:
    """Return the card of a mode, with the tiles of its proof."""
    mode = result.modes[place]
    home = mode.medoid_campaign or campaign
    return ModeCard(
        number=place + 1,
        failures=mode.failures,
        share=format_share(mode.failures / len(result.episodes)),
        words=describe_mode_card(result, place),
        probability=make_probability_tile(mode.probability),
        medoid=mode.medoid,
        medoid_campaign=home,
        clip=f"/campaigns/{home}/episodes/{mode.medoid}/clip",
        strength=format_number(float(np.sqrt(np.mean(np.square(mode.eigenfailure))))),
        proof=proof,
    )


def describe_mode_card(result: AnalysisResult, place: int) -> str:
    """Return the description of a mode without its number, which the card's heading has."""
    if not result.words:
        return f"Strongest noise: {describe_peak(result.modes[place], result.channels)}."
    return put_minus_signs(result.words[place].removeprefix(f"Mode {place + 1}: "))


def make_proof_tiles(proven: ProvenMode, unit: str) -> tuple[tuple[str, Tile], ...]:
    """Return the tiles of the replays of a mode's two trajectories in all scenarios."""
    tiles = (
        ("Eigenfailure reproduced", describe_reproduction(proven.eigenfailure, unit)),
        ("Medoid reproduced", describe_reproduction(proven.medoid, unit)),
    )
    if proven.nearest is None:
        return tiles
    place, _, words = proven.nearest.words.partition(": ")
    nearest = Tile(f"t = {format_number(proven.nearest.t)}", (words or place,))
    return (*tiles, ("Nearest failing point", nearest))


WAYS = {"longitudinal": ("ahead", "back"), "lateral": ("towards +y", "towards −y")}
"""Of positive and of negative noise of a position."""


def describe_peak(mode: FailureMode, channels: Sequence[str]) -> str:
    """Return the channel, strength and time of an eigenfailure's strongest noise."""
    z = mode.eigenfailure
    step, way = np.unravel_index(int(np.abs(z).argmax()), z.shape)
    value, channel = float(z[step, way]), channels[int(way)]
    signs = WAYS.get(channel, (f"of positive {channel}", f"of negative {channel}"))
    return f"{format_number(abs(value), 2)} sigma {signs[value < 0.0]} at step {step}"


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)


@router.get("/analyses/{analysis}")
def show_analysis(store: Stored, analysis: AnalysisId) -> HTMLResponse:
    """One analysis."""
    seen = store.analyses.get(analysis)
    proven = summarise_proof(store, seen) if seen.result else None
    return page(
        "analysis.html", make_analysis_view(seen, store.campaigns.get(seen.campaign), proven)
    )
