"""The charts of an analysis: its modes, its components, its influence, and its training."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial

import numpy as np

from eigenfail.presentation.analyses import pick_channels, rank_channels
from eigenfail.presentation.figures import UNKNOWN, format_count, format_number, format_share
from eigenfail.values import (
    AnalysisResult,
    Floats,
    Moment,
    TrainingInterval,
)
from eigenfail_api.dashboard import charts

MOST_POINTS = 5_000

TableParts = tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]
"""Columns and rows of a table."""


def make_behaviour_charts(result: AnalysisResult) -> tuple[charts.Chart, ...]:
    """Return the chart of the ego's acceleration in each mode; none where it is not known."""
    behaviour, noun = result.behaviour, result.cluster_noun
    if behaviour is None:
        return ()
    event = "collision" if behaviour.origin == "collision" else "start"
    chart = charts.Chart(
        id="behaviour-chart",
        kind="behaviour",
        title="Acceleration of the ego",
        caption=f"What the ego did in each {noun}, by the time from the {event} [m/s²]. Thick: the "
        "mean of its failures. Thin: some of them.",
        data={
            "noun": noun,
            "event": event,
            "times": list_floats(behaviour.times_s),
            "modes": [
                {"mean": list_floats(mode.mean), "members": charts.round_rows(mode.members)}
                for mode in behaviour.modes
            ],
        },
        columns=(
            f"Time from the {event} [s]",
            *(f"{noun.capitalize()} {place + 1}" for place in range(len(behaviour.modes))),
        ),
        rows=tuple(
            (format_number(float(time_s)), *(format_number(float(value)) for value in values))
            for time_s, *values in zip(
                behaviour.times_s, *(mode.mean for mode in behaviour.modes), strict=True
            )
        ),
    )
    return (chart,)


GREATEST = "the greatest influence"


def rank_shown(result: AnalysisResult) -> tuple[list[int], list[int]]:
    """Return the columns of the channels that are shown at first, and of all in that order."""
    shown = pick_channels(result.influence)
    if len(shown) == len(result.channels):
        return shown, shown
    return shown, rank_channels(result.influence)


def make_channel_table(
    result: AnalysisResult, make: Callable[[list[int]], TableParts]
) -> charts.ChannelTable | None:
    """Return the table of all channels; None if all are in the table that is shown at first.

    Args:
        result: result of the analysis.
        make: makes columns and rows of the channels in these columns of the noise.
    """
    shown, ranked = rank_shown(result)
    return charts.ChannelTable(len(ranked), *make(ranked)) if len(shown) < len(ranked) else None


def make_eigenfailure_chart(result: AnalysisResult) -> charts.Chart:
    """Return the chart of each mode's eigenfailure with its band."""
    modes = [mode.eigenfailure for mode in result.modes]
    bands = [mode.band for mode in result.modes if mode.band is not None]
    channels, noun = result.channels, result.cluster_noun
    shown, ranked = rank_shown(result)
    make = partial(make_eigenfailure_table, result)
    columns, rows = make(shown)
    return charts.Chart(
        id="eigenfailure-chart",
        kind="eigenfailures",
        title="Eigenfailures",
        caption=f"Centre of the noise of each {noun} over time [sigma], by channel."
        + (" Bands: from 10 to 90 % of the noise of its failures at each step." if bands else "")
        + charts.describe_shown(shown, channels, GREATEST),
        data={
            "noun": noun,
            "channels": {channels[way]: [list_floats(z[:, way]) for z in modes] for way in ranked},
            "bands": {channels[way]: list_band_limits(bands, way) for way in ranked},
        },
        columns=columns,
        rows=rows,
        every=make_channel_table(result, make),
    )


def make_eigenfailure_table(result: AnalysisResult, ways: list[int]) -> TableParts:
    """Return columns and rows of the eigenfailures and bands of all modes in these channels."""
    modes = [mode.eigenfailure for mode in result.modes]
    bands = [mode.band for mode in result.modes if mode.band is not None]
    channels = [result.channels[way] for way in ways]
    names = [f"{result.cluster_noun.capitalize()} {place + 1}" for place in range(len(modes))]
    columns = (
        "Step",
        *(f"{name} {channel}" for name in names for channel in channels),
        *name_band_columns(names[: len(bands)], channels),
    )
    sides = [side for band in bands for side in band]
    return columns, make_step_table(
        np.concatenate([each[:, ways] for each in (*modes, *sides)], axis=1)
    )


def list_band_limits(bands: Iterable[Floats], way: int) -> list[list[list[float | None]]]:
    """Return the lower and the upper limit of each mode's band in a channel."""
    return [[list_floats(side[:, way]) for side in band] for band in bands]


def name_band_columns(modes: Sequence[str], channels: Sequence[str]) -> Iterator[str]:
    """Names of the columns of bands of these modes, in the order of their numbers."""
    for name in modes:
        for share in ("10 %", "90 %"):
            yield from (f"{name} {channel} {share}" for channel in channels)


def make_scores_chart(result: AnalysisResult, campaign: int) -> charts.Chart:
    """Return the chart of failures in PCA space, of `campaign` unless the result names others."""
    chosen = pick_evenly(len(result.episodes), MOST_POINTS)
    second = 1 if result.scores.shape[1] > 1 else 0
    centres = np.stack([mode.centre for mode in result.modes])
    addresses = list_episode_names(result, campaign)
    return charts.Chart(
        id="scores-chart",
        kind="scores",
        title="Failures in PCA space",
        caption="Each failure by the first two scores of its noise; colour and shape show the "
        f"{result.cluster_noun}, + its mean.",
        data={
            "noun": result.cluster_noun,
            "episode": [addresses[row] for row in chosen],
            "mode": [result.labels[row] for row in chosen],
            "x": list_floats(result.scores[chosen, 0]),
            "y": list_floats(result.scores[chosen, second]),
            "centres": [list_floats(centre[[0, second]]) for centre in centres],
        },
        columns=("Episode", result.cluster_noun.capitalize(), "First score", "Second score"),
        rows=tuple(
            (
                addresses[row],
                str(result.labels[row] + 1),
                format_number(float(result.scores[row, 0])),
                format_number(float(result.scores[row, second])),
            )
            for row in chosen[: charts.MOST_ROWS]
        ),
        note=f"The first {charts.MOST_ROWS}." if len(chosen) > charts.MOST_ROWS else "",
    )


def make_explained_chart(result: AnalysisResult) -> charts.Chart:
    """Return the chart of the variance that each component explains."""
    cumulated = np.cumsum(result.explained)
    return charts.Chart(
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


def make_influence_chart(result: AnalysisResult) -> charts.Chart:
    """Return the chart of the influence of noise over time."""
    shown, ranked = rank_shown(result)
    make = partial(make_influence_table, result)
    columns, rows = make(shown)
    return charts.Chart(
        id="influence-chart",
        kind="influence",
        title="Influence over time",
        caption="Where the noise of the failures differs, which is no cause: components weighted "
        "by explained variance. Marks: the moments of greatest influence."
        + charts.describe_shown(shown, result.channels, GREATEST),
        data={
            "channels": {
                result.channels[way]: list_floats(result.influence[:, way]) for way in ranked
            },
            "moments": [draw_moment(each) for each in result.moments],
        },
        columns=columns,
        rows=rows,
        every=make_channel_table(result, make),
    )


def make_influence_table(result: AnalysisResult, ways: list[int]) -> TableParts:
    """Return columns and rows of the influence of these channels."""
    columns = ("Step", *(result.channels[way].capitalize() for way in ways))
    return columns, make_step_table(result.influence[:, ways])


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
    return charts.round_values(float(value) for value in values)


MOST_STEPS = 200
"""Points of a line: more cannot be distinguished on a screen."""

DIGITS = 3

Lines = Callable[[TrainingInterval], Iterable[Floats]]


def make_training_charts(result: AnalysisResult) -> tuple[charts.Chart, ...]:
    """Return the charts over the training; none for results of older releases."""
    if not result.training:
        return ()
    return (make_mean_chart(result), make_component_chart(result))


def make_mean_chart(result: AnalysisResult) -> charts.Chart:
    """Return the chart of the mean disturbance of the failures."""
    shown, ranked = rank_shown(result)
    make = partial(make_mean_table, result)
    columns, rows = make(shown)
    return charts.Chart(
        id="training-mean-chart",
        kind="training",
        title="Mean disturbance during the search",
        caption="Mean noise of the failures of each tenth of the episodes, over their steps "
        "[sigma]: the first tenth on top."
        + charts.describe_shown(shown, result.channels, GREATEST),
        data=make_ridges(result, ranked, ("mean",), lambda interval: [interval.mean], unit="sigma"),
        columns=columns,
        rows=rows,
        every=make_channel_table(result, make),
    )


def make_mean_table(result: AnalysisResult, ways: list[int]) -> TableParts:
    """Return columns and rows of the mean noise of each interval in these channels."""
    intervals = result.training
    spans = [format_span(each) for each in intervals]
    columns = ("Step", *(f"{result.channels[way]} {span}" for way in ways for span in spans))
    means = [each.mean[:, [way]] for way in ways for each in intervals]
    return columns, make_step_table(np.concatenate(means, axis=1))


def make_component_chart(result: AnalysisResult) -> charts.Chart:
    """Return the chart of the components of each interval."""
    intervals = result.training
    count = max(len(each.components) for each in intervals)
    shown, ranked = rank_shown(result)
    return charts.Chart(
        id="training-components-chart",
        kind="training",
        title="Components during the search",
        caption="The first components of the failures of each tenth alone, turned towards those "
        "of all; the legend shows the others. Likeness is |cosine| with the component of all "
        "failures: 1 is the same." + charts.describe_shown(shown, result.channels, GREATEST),
        data=make_ridges(
            result,
            ranked,
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
    result: AnalysisResult,
    ways: Sequence[int],
    names: tuple[str, ...],
    lines: Lines,
    *,
    unit: str,
) -> dict[str, object]:
    """Return the lines [unit] by channel, interval and name; an interval may have no failures."""
    intervals = result.training
    steps = pick_evenly(len(intervals[0].mean), MOST_STEPS)
    return {
        "names": names,
        "unit": unit,
        "spans": [format_span(each) for each in intervals],
        "steps": steps,
        "channels": {
            result.channels[way]: [
                [round_ridge_values(line[steps, way]) for line in lines(each)]
                if each.failures
                else []
                for each in intervals
            ]
            for way in ways
        },
    }


def round_ridge_values(values: Floats) -> list[float]:
    """Return the values with as many digits as a chart can show."""
    return [float(f"{value:.{DIGITS}g}") for value in np.asarray(values, np.float64)]


def format_span(interval: TrainingInterval) -> str:
    """Return the first and the last episode of an interval as text."""
    return f"{100.0 * interval.start:.0f} – {100.0 * interval.end:.0f} %"


def make_mode_charts(result: AnalysisResult, campaign: int) -> tuple[charts.Chart, ...]:
    """Return the charts that show how the modes of an analysis differ."""
    return (
        make_eigenfailure_chart(result),
        *make_behaviour_charts(result),
        make_scores_chart(result, campaign),
    )


def make_detail_charts(result: AnalysisResult) -> tuple[charts.Chart, ...]:
    """Return the charts of the components of an analysis, of influence and of training."""
    return (
        make_explained_chart(result),
        make_influence_chart(result),
        *make_training_charts(result),
    )
