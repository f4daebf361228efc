"""The failures through training: ten intervals of the episodes, drawn one below the other."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from eigenfail.values import AXES, AnalysisResult, Floats, TrainingInterval
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.charts import Chart
from eigenfail_api.dashboard.views.modes import by_step, evenly

MOST_STEPS = 200
"""Points of a line: more cannot be told apart on a screen."""

DIGITS = 3

Lines = Callable[[TrainingInterval], Iterable[Floats]]


def training_charts(result: AnalysisResult) -> tuple[Chart, ...]:
    """Mean and components; nothing in results of older releases."""
    intervals = result.training
    return (mean_chart(intervals), component_chart(intervals)) if intervals else ()


def mean_chart(intervals: Sequence[TrainingInterval]) -> Chart:
    """The mean disturbance of the failures."""
    return Chart(
        id="training-mean-chart",
        kind="training",
        title="Mean disturbance through training",
        caption="Mean noise of the failures of each tenth of the episodes, over their steps "
        "[sigma]: the first tenth on top.",
        data=ridges(intervals, ("mean",), lambda interval: [interval.mean], "sigma"),
        columns=("Step", *(f"{axis} {span(each)}" for axis in AXES for each in intervals)),
        rows=by_step(
            np.concatenate(
                [each.mean[:, way : way + 1] for way in (0, 1) for each in intervals], axis=1
            )
        ),
    )


def component_chart(intervals: Sequence[TrainingInterval]) -> Chart:
    """The components of each interval by itself."""
    count = max(len(each.components) for each in intervals)
    return Chart(
        id="training-components-chart",
        kind="training",
        title="Components through training",
        caption="The first components of the failures of each tenth alone, turned towards those "
        "of all; the legend shows the others. Likeness is |cosine| with the component of all "
        "failures: 1 is the same.",
        data=ridges(
            intervals,
            tuple(f"component {place + 1}" for place in range(count)),
            lambda interval: interval.components,
            unit="",
        ),
        columns=("Episodes", "Failures", "Component", "Explained", "Likeness"),
        rows=tuple(row for each in intervals for row in component_rows(each)),
        note="By interval; each step by itself is in the API.",
    )


def component_rows(interval: TrainingInterval) -> list[tuple[str, ...]]:
    """A row for each component; one with dashes where there is none."""
    head = (span(interval), formats.integer(interval.failures))
    rows: list[tuple[str, ...]] = [
        (*head, str(place), formats.percent(float(share)), formats.number(float(likeness)))
        for place, (share, likeness) in enumerate(
            zip(interval.explained, interval.likeness, strict=True), start=1
        )
    ]
    return rows or [(*head, *[formats.NONE] * 3)]


def ridges(
    intervals: Sequence[TrainingInterval], names: tuple[str, ...], lines: Lines, unit: str
) -> dict[str, object]:
    """Lines [unit] by axis, interval and name; an interval without failures has none."""
    steps = evenly(len(intervals[0].mean), MOST_STEPS)
    return {
        "names": names,
        "unit": unit,
        "spans": [span(each) for each in intervals],
        "steps": steps,
        **{
            axis: [
                [short(line[steps, way]) for line in lines(each)] if each.failures else []
                for each in intervals
            ]
            for way, axis in enumerate(AXES)
        },
    }


def short(values: Floats) -> list[float]:
    """With as many digits as a ridge can show."""
    return [float(f"{value:.{DIGITS}g}") for value in np.asarray(values, np.float64)]


def span(interval: TrainingInterval) -> str:
    """From where to where in the episodes."""
    return f"{100.0 * interval.start:.0f} – {100.0 * interval.end:.0f} %"
