"""The charts of an analysis: its modes, its components, its influence, and its training."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from eigenfail.presentation.figures import UNKNOWN, format_number, format_share
from eigenfail.values.analysis import AnalysisResult, Moment, TrainingInterval
from eigenfail.values.arrays import Floats
from eigenfail_api.dashboard import charts

MOST_POINTS = 5_000
GREATEST = "the greatest influence"


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


def make_behaviour_charts(result: AnalysisResult) -> tuple[charts.Chart, ...]:
    """Return the chart of the ego's acceleration in each mode; none if it is not known."""
    behaviour, noun = result.behaviour, result.cluster_noun
    if behaviour is None:
        return ()
    event = "collision" if behaviour.origin == "collision" else "start"
    means = [mode.mean for mode in behaviour.modes]
    chart = charts.Chart(
        id="behaviour-chart",
        kind="behaviour",
        title="Acceleration of the ego",
        caption=f"What the ego did in each {noun}, by the time from the {event} [m/s²]. Thick: the "
        "mean of its failures. Thin: some of them.",
        data={
            "noun": noun,
            "event": event,
            "times": behaviour.times_s,
            "modes": [{"mean": mode.mean, "members": mode.members} for mode in behaviour.modes],
        },
        table=charts.ChartTable(
            (f"Time from the {event} [s]", *_number_modes(result, len(means))),
            np.column_stack((behaviour.times_s, *means)).tolist(),
        ),
    )
    return (chart,)


def _number_modes(result: AnalysisResult, count: int) -> list[str]:
    return [f"{result.cluster_noun.capitalize()} {place + 1}" for place in range(count)]


def make_eigenfailure_chart(result: AnalysisResult) -> charts.Chart:
    """Return the chart of each mode's eigenfailure with its band."""
    names, channels = _number_modes(result, len(result.modes)), result.channels
    bands = [mode.band for mode in result.modes if mode.band is not None]

    def draw(ways: Sequence[int]) -> dict[str, object]:
        return {
            "noun": result.cluster_noun,
            "channels": {
                channels[way]: [mode.eigenfailure[:, way] for mode in result.modes] for way in ways
            },
            "bands": {
                channels[way]: [[side[:, way] for side in band] for band in bands] for way in ways
            },
        }

    def tabulate(ways: Sequence[int]) -> charts.ChartTable:
        shown = [channels[way] for way in ways]
        columns = [f"{name} {channel}" for name in names for channel in shown]
        lines = [mode.eigenfailure for mode in result.modes]
        for name, band in zip(names, bands, strict=False):
            for share, side in zip(("10 %", "90 %"), band, strict=True):
                columns += [f"{name} {channel} {share}" for channel in shown]
                lines.append(side)
        # One matrix for modes and bands: a table has one row for each step.
        values = np.concatenate([line[:, ways] for line in lines], axis=1)
        return tabulate_steps(columns, values)

    in_words = f"Centre of the noise of each {result.cluster_noun} over time [sigma], by channel."
    more = " Bands: from 10 to 90 % of the noise of its failures at each step." if bands else ""
    plot = charts.ChannelPlot(channels, result.influence, draw, tabulate)
    return plot.make_chart(
        "eigenfailure-chart", "eigenfailures", "Eigenfailures", f"{in_words}{more}", GREATEST
    )


def make_scores_chart(result: AnalysisResult, campaign: int) -> charts.Chart:
    """Return the chart of failures in PCA space, of `campaign` unless the result names others."""
    chosen = pick_evenly(len(result.episodes), MOST_POINTS)
    # With a single component both axes show it, so that the chart is a diagonal and no error.
    second = 1 if result.scores.shape[1] > 1 else 0
    owners = result.campaigns or (campaign,) * len(result.episodes)
    names = [f"{owner}/{index}" for owner, index in zip(owners, result.episodes, strict=True)]
    x, y = (result.scores[:, way] for way in (0, second))
    return charts.Chart(
        id="scores-chart",
        kind="scores",
        title="Failures in PCA space",
        caption="Each failure by the first two scores of its noise; colour and shape show the "
        f"{result.cluster_noun}, + its mean.",
        data={
            "noun": result.cluster_noun,
            "episode": [names[row] for row in chosen],
            "mode": [result.labels[row] for row in chosen],
            "x": x[chosen],
            "y": y[chosen],
            "centres": [mode.centre[[0, second]] for mode in result.modes],
        },
        table=charts.ChartTable(
            ("Episode", result.cluster_noun.capitalize(), "First score", "Second score"),
            [
                (names[row], str(result.labels[row] + 1), float(x[row]), float(y[row]))
                for row in chosen[: charts.MOST_ROWS]
            ],
            charts.note_the_first(len(chosen)),
        ),
    )


def make_explained_chart(result: AnalysisResult) -> charts.Chart:
    """Return the chart of the variance that each component explains."""
    cumulated = np.cumsum(result.explained)
    shares = zip(map(float, result.explained), map(float, cumulated), strict=True)
    return charts.Chart(
        id="explained-chart",
        kind="explained",
        title="Explained variance",
        caption="Share of the variance by component, and cumulative.",
        data={
            "share": 100.0 * result.explained,
            "cumulated": 100.0 * cumulated,
        },
        table=charts.ChartTable(
            ("Component", "Share", "Cumulated"),
            [(str(place), *map(format_share, pair)) for place, pair in enumerate(shares, start=1)],
        ),
    )


def make_influence_chart(result: AnalysisResult) -> charts.Chart:
    """Return the chart of the influence of noise over time."""
    channels, influence = result.channels, result.influence

    def draw(ways: Sequence[int]) -> dict[str, object]:
        return {
            "channels": {channels[way]: influence[:, way] for way in ways},
            "moments": list(map(draw_moment, result.moments)),
        }

    def tabulate(ways: Sequence[int]) -> charts.ChartTable:
        return tabulate_steps((channels[way].capitalize() for way in ways), influence[:, ways])

    caption = (
        "Steps at which the noise of the failures differs: components weighted by explained "
        "variance. A difference is not yet a cause. Marks: the moments of greatest influence."
    )
    plot = charts.ChannelPlot(channels, influence, draw, tabulate)
    return plot.make_chart("influence-chart", "influence", "Influence over time", caption, GREATEST)


def draw_moment(found: Moment) -> dict[str, object]:
    """Return the JSON that the page's chart draws for a moment."""
    before_s = found.before_collision_s
    text = "" if before_s is None else f"{format_number(before_s)} s before the collision"
    return {"axis": found.axis, "step": found.step, "time": text}


def tabulate_steps(titles: Iterable[str], values: Floats) -> charts.ChartTable:
    """Return a table of the values: a row for each step, a column for each title."""
    rows = [(str(step), *row) for step, row in enumerate(values.tolist())]
    return charts.ChartTable(("Step", *titles), rows)


def pick_evenly(count: int, most: int) -> list[int]:
    """Return at most `most` of `count` positions, spread evenly."""
    taken = min(count, most)
    # Integers alone: positions are distinct, and the same on every machine.
    return [place * count // taken for place in range(taken)] if taken else []


MOST_STEPS = 200
"""Points of a line: more cannot be distinguished on a screen."""

Lines = Callable[[TrainingInterval], Iterable[Floats]]


def make_training_charts(result: AnalysisResult) -> tuple[charts.Chart, ...]:
    """Return the charts over the training; none for results of older releases."""
    intervals = result.training
    if not intervals:
        return ()
    spans = [format_span(each) for each in intervals]

    def draw_means(ways: Sequence[int]) -> dict[str, object]:
        return make_ridges(result, ways, ["mean"], lambda each: [each.mean], unit="sigma")

    def tabulate_means(ways: Sequence[int]) -> charts.ChartTable:
        means = [each.mean[:, [way]] for way in ways for each in intervals]
        # By channel first, so that the tenths of one channel stand beside each other.
        columns = (f"{result.channels[way]} {span}" for way in ways for span in spans)
        return tabulate_steps(columns, np.concatenate(means, axis=1))

    count = max(len(each.components) for each in intervals)
    names = tuple(f"component {place + 1}" for place in range(count))

    def draw_components(ways: Sequence[int]) -> dict[str, object]:
        return make_ridges(result, ways, names, lambda each: each.components, unit="")

    means = charts.ChannelPlot(result.channels, result.influence, draw_means, tabulate_means)
    # Components have a row each for all channels together: a table of more channels is the same.
    table = charts.ChartTable(
        ("Episodes", "Failures", "Component", "Explained", "Likeness"),
        [row for each in intervals for row in list_component_rows(each)],
        ("By interval; single steps are in the API.",),
    )
    components = charts.ChannelPlot(
        result.channels, result.influence, draw_components, lambda _: table
    )
    return (
        means.make_chart(
            "training-mean-chart",
            "training",
            "Mean disturbance during the search",
            "Mean noise of the failures of each tenth of the episodes, over their steps [sigma]: "
            "the first tenth on top.",
            GREATEST,
        ),
        components.make_chart(
            "training-components-chart",
            "training",
            "Components during the search",
            "The first components of the failures in each tenth, turned towards the components of "
            "all failures; the legend shows the others. Likeness is |cosine| with the component of "
            "all failures: 1 is the same.",
            GREATEST,
        ),
    )


def list_component_rows(interval: TrainingInterval) -> list[charts.Row]:
    """Return a row for each component; with dashes for a missing component."""
    head = (format_span(interval), interval.failures)
    found = zip(interval.explained, interval.likeness, strict=True)
    rows: list[charts.Row] = [
        (*head, str(place), format_share(float(share)), float(likeness))
        for place, (share, likeness) in enumerate(found, start=1)
    ]
    # A tenth without failures keeps its row: that nothing was found is a result, too.
    return rows or [(*head, *[UNKNOWN] * 3)]


def make_ridges(
    result: AnalysisResult, ways: Sequence[int], names: Sequence[str], lines: Lines, *, unit: str
) -> dict[str, object]:
    """Return lines [unit] by channel, interval and name; empty for intervals without failures."""
    intervals = result.training
    steps = pick_evenly(len(intervals[0].mean), MOST_STEPS)
    return {
        "names": names,
        "unit": unit,
        "spans": [format_span(each) for each in intervals],
        "steps": steps,
        "channels": {
            result.channels[way]: [
                [line[steps, way] for line in lines(each)]
                # A tenth without failures does not have a mean; an empty list keeps its place.
                if each.failures
                else []
                for each in intervals
            ]
            for way in ways
        },
    }


def format_span(interval: TrainingInterval) -> str:
    """Return the first and the last episode of an interval as text."""
    return f"{100.0 * interval.start:.0f} – {100.0 * interval.end:.0f} %"
