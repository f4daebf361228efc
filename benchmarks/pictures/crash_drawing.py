"""A crash by shaped noise: what was so, what was perceived, what the planner believed."""

from collections.abc import Callable, Iterator, Sequence
from itertools import groupby
from typing import NamedTuple

from benchmarks.pictures.courses import WAVE_HALF_PERIOD, WAVE_SIGMA, crash
from benchmarks.pictures.svg import WIDTH, Point, box, dot, line, page, text

from eigenfail.values.proof import ExplainedEpisode, ExplainedStep

LEFT, RIGHT = 60.0, 20.0
Value = Callable[[ExplainedStep], float | None]


class Chart(NamedTuple):
    """A frame of the page with its axes.

    Attributes:
        end_s: of the time axis, which begins at 0.
        low: value at the lower edge; high likewise.
    """

    top: float
    height: float
    end_s: float
    low: float
    high: float

    def place(self, time_s: float, value: float) -> Point:
        """Where a value at a time is drawn."""
        x = LEFT + time_s / self.end_s * (WIDTH - LEFT - RIGHT)
        share = (value - self.low) / (self.high - self.low)
        return Point(x, self.top + self.height * (1.0 - min(max(share, 0.0), 1.0)))

    def frame(self, title: str, every: int) -> Iterator[str]:
        """Title, and a line for each round value."""
        yield text(Point(LEFT, self.top - 8.0), title)
        for value in range(int(self.low), int(self.high) + 1, every):
            start, end = self.place(0.0, value), self.place(self.end_s, value)
            yield line((start, end), "line faint")
            yield text(Point(LEFT - 8.0, start.y + 4.0), str(value), "end")

    def course(self, steps: Sequence[ExplainedStep], value: Value, css: str) -> Iterator[str]:
        """A line through a value, broken where there is none."""
        for known, run in groupby(steps, lambda step: value(step) is not None):
            points = [self.place(step.time_s, value(step) or 0.0) for step in run]
            if known:
                yield line(points, css)


def read_belief(name: str) -> Value:
    """A number of the planner's account; None while it heeds nobody."""

    def value(step: ExplainedStep) -> float | None:
        said = step.account.get(name)
        return said if isinstance(said, float) else None

    return value


def crash_view() -> str:
    """The picture."""
    found = crash()
    end_s = found.steps[-1].time_s + 0.1
    gaps = Chart(top=72.0, height=250.0, end_s=end_s, low=0.0, high=100.0)
    speeds = Chart(top=372.0, height=130.0, end_s=end_s, low=0.0, high=16.0)
    drawn = [
        *legend(),
        *(
            drawing
            for chart in (gaps, speeds)
            for drawing in list_unheeded_times(chart, found.steps)
        ),
        *gaps.frame("gap between bumpers [m]", 20),
        *speeds.frame("closing speed [m/s]", 4),
        *map(dot, list_perceived_gaps(gaps, found)),
        *gaps.course(found.steps, lambda step: step.gap_m, "true"),
        *gaps.course(found.steps, read_belief("gap_m"), "believed"),
        *speeds.course(found.steps, lambda step: step.closing_mps, "true"),
        *speeds.course(found.steps, read_belief("closing_mps"), "believed"),
        *times(speeds),
    ]
    return page(548.0, "A crash by shaped noise: gap and closing speed over time", drawn)


def legend() -> Iterator[str]:
    """What the picture shows, and what its lines stand for."""
    words = (
        f"±{WAVE_SIGMA:g} sigma along the road, the sign changing every {WAVE_HALF_PERIOD} steps"
    )
    yield text(Point(LEFT, 24.0), f"cut_in, collision under a slow wave of noise: {words}")
    for x, css, words in ((470.0, "true", "true"), (550.0, "believed", "believed by the planner")):
        yield line((Point(x, 48.0), Point(x + 24.0, 48.0)), css)
        yield text(Point(x + 30.0, 52.0), words)
    yield dot(Point(760.0, 48.0))
    yield text(Point(768.0, 52.0), "perceived")
    yield box(Point(850.0, 41.0), 18.0, 13.0, "lost")
    yield text(Point(873.0, 52.0), "no track")


def list_perceived_gaps(chart: Chart, found: ExplainedEpisode) -> Iterator[Point]:
    """The gap as perceived in each step."""
    scene = found.result.scene
    if scene is None:
        return
    half_lengths_m = scene.sizes[:2, 0].sum() / 2.0
    truck_x_m = scene.vehicles[: len(scene.perceived), 0, 0]
    gaps_m = (scene.perceived[:, 0] - truck_x_m - half_lengths_m).tolist()
    for step, gap_m in zip(found.steps, gaps_m, strict=True):
        yield chart.place(step.time_s, gap_m)


def list_unheeded_times(chart: Chart, steps: Sequence[ExplainedStep]) -> Iterator[str]:
    """The times at which the planner knew of nobody."""
    for nobody, run in groupby(steps, lambda step: step.account["heeds"] == "nobody"):
        times_s = [step.time_s for step in run]
        if nobody:
            corner = chart.place(times_s[0], chart.high)
            width = chart.place(times_s[-1] + 0.1, chart.high).x - corner.x
            yield box(corner, width, chart.height, "lost")


def times(chart: Chart) -> Iterator[str]:
    """The time axis, and the collision at its end."""
    for second in range(int(chart.end_s) + 1):
        at = chart.place(second, chart.low)
        yield text(Point(at.x, at.y + 18.0), str(second), "middle")
    yield text(Point(LEFT, chart.top + chart.height + 36.0), "time [s]; the collision ends it")
