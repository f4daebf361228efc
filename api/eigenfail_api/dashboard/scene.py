"""The scene of an episode over time, failures over each other, and the planner's account."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import ceil, floor, inf, log10, nan
from typing import NamedTuple

import msgspec
import numpy as np

from eigenfail.contracts.recording import OverlaidRecordings
from eigenfail.explanations import NOTHING, SOLVED, read_word
from eigenfail.presentation.figures import UNKNOWN, format_number
from eigenfail.values.arrays import Floats
from eigenfail.values.disturbance import AXES, NoiseTrajectory
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.measures import MEASURES, Measures
from eigenfail.values.proof import ExplainedStep, Explanation
from eigenfail.values.scene import UNKNOWN_KIND, Mission, Scene
from eigenfail_api.dashboard import charts
from eigenfail_services.analysis import footprints

_MOST_MOMENTS = 12
"""More jumps than these would hide each other."""


class NotableMoment(msgspec.Struct, frozen=True):
    """A moment of an episode that the player offers to jump to."""

    time_s: float
    words: str


def find_moments(steps: Sequence[ExplainedStep]) -> tuple[NotableMoment, ...]:
    """Find the first moments at which a track is lost, a plan overridden or a program unsolved."""
    found = (one for before, now in pairwise(steps) for one in _find_beginnings(before, now))
    return tuple(one for one, _ in zip(found, range(_MOST_MOMENTS), strict=False))


def _find_beginnings(before: ExplainedStep, now: ExplainedStep) -> Iterator[NotableMoment]:
    if (read_figure(now, "lost_tracks") or 0.0) > (read_figure(before, "lost_tracks") or 0.0):
        yield NotableMoment(now.time_s, "track lost")
    override = read_word(now, "override")
    if override not in NOTHING and override != read_word(before, "override"):
        yield NotableMoment(now.time_s, override.replace("_", " "))
    if read_word(now, "qp_status") not in SOLVED and read_word(before, "qp_status") in SOLVED:
        yield NotableMoment(now.time_s, "program not solved")


def list_jumps(result: EpisodeResult) -> list[NotableMoment]:
    """Return the notable moments of an episode, in order of time."""
    found = [*find_threshold_moments(result.measures)] if result.measures else []
    # Of a failure the collision is the moment to see; of any other the nearest approach.
    if result.scene and not result.is_failure:
        found.append(NotableMoment(find_nearest_moment(result.scene), "nearest"))
    return sorted(found, key=lambda each: each.time_s)


def find_threshold_moments(measures: Measures) -> Iterator[NotableMoment]:
    """Yield the moments at which thresholds were passed, and the collision."""
    for name, measure in MEASURES.items():
        if measure.event and (time_s := getattr(measures, name)) is not None:
            yield NotableMoment(time_s, measure.event)


CONVENTIONAL_LANE_M = 3.5


def make_noise_chart(
    noise: NoiseTrajectory, dt_s: float | None, channels: Sequence[str] = AXES
) -> charts.Chart:
    """Return the chart of the noise of the given channels, step by step."""
    standardised = noise.standardised
    times = [step * (dt_s or 1.0) for step in range(len(noise.z))]
    axis = "Time [s]" if dt_s else "Step"
    # The default channels of a function have these names, too, and are no positions.
    is_position = dt_s is not None and tuple(channels) == AXES
    unit = "[m]" if is_position else "injected"

    def draw(ways: Sequence[int]) -> dict[str, object]:
        return {
            "axis": axis,
            "end": len(times) * (dt_s or 1.0),
            "time": charts.collect_floats(times),
            "channels": {channels[way]: standardised[:, way] for way in ways},
        }

    def tabulate(ways: Sequence[int]) -> charts.ChartTable:
        names = [channels[way].capitalize() for way in ways]
        columns = [f"{name} {kind}" for kind in ("[sigma]", unit) for name in names]
        values = (standardised[:, ways], noise.injected[:, ways], noise.log_probability_per_step)
        steps = zip(times, *values, strict=True)
        rows = [(at, *map(float, (*u, *a, log_p))) for at, u, a, log_p in steps]
        return charts.ChartTable((axis, *columns, "log p"), rows)

    title = "Noise on the perceived position" if is_position else "Noise"
    caption = (
        f"In standard deviations of the disturbance model ({noise.shape.in_words()}); the band is "
        "±2 sigma."
    )
    plot = charts.ChannelPlot(channels, np.square(standardised), draw, tabulate)
    return plot.make_chart("noise-chart", "noise", title, caption, "the strongest noise")


LONGEST_TTC_S = 10.0
"""Times to collision beyond it are not drawn: nothing is near. [s]"""


class StripScale(NamedTuple):
    """The values that the axis of a strip covers at least, in the unit of the strip.

    Without it, rounding noise would fill the strip, and a truck that does nothing would seem to
    brake.
    """

    low: float
    high: float


TICKS = 3
"""Steps of the axis of a strip, about."""
ROUND_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)


def make_ticks(values: Floats, least: StripScale) -> tuple[float, float, float]:
    """Return low end, high end and step of the axis of a strip, in round numbers."""
    finite = values[np.isfinite(values)]
    low = float(min(least.low, *finite)) if len(finite) else least.low
    high = float(max(least.high, *finite)) if len(finite) else least.high
    power = 10.0 ** floor(log10((high - low) / TICKS))
    step = next(each * power for each in ROUND_STEPS if each * power * TICKS >= high - low)
    return (round(floor(low / step) * step, 6), round(ceil(high / step) * step, 6), step)


COURSE_CAPTIONS = {
    "clearance": "Between the footprints.",
    "ttc": "Distance ÷ closing speed, of the vehicle for which it is shortest. No line above "
    f"{LONGEST_TTC_S:g} s, and where no vehicle is in the ego's path.",
    "speed": "As it was in the simulator.",
    "acceleration": "As the planner commanded it.",
}
"""Captions of the charts by the beginning of their ids."""


def make_course_charts(scene: Scene) -> tuple[charts.Chart, ...]:
    """Return the charts of distance, time to collision, speed and acceleration over time.

    The smallest distance is the robustness, and the smallest time to collision is MinTTC.
    """
    dt_s, ttc_s = scene.dt_s, footprints.measure_times_to_collision(scene)
    end_s = dt_s * (len(scene.vehicles) - 1)
    # A far vehicle would flatten the part of the curve that matters.
    near_s = np.where(ttc_s <= LONGEST_TTC_S, ttc_s, nan)
    accelerations = scene.controls.reshape(-1, 2)[:, 0]
    apart = footprints.measure_clearances(scene).min(axis=1)
    courses = (
        ("Distance to the nearest vehicle", "m", apart, StripScale(0.0, 5.0)),
        ("Time to collision", "s", near_s, StripScale(0.0, 3.0)),
        ("Speed of the ego", "m/s", scene.vehicles[:, 0, 3], StripScale(0.0, 5.0)),
        ("Acceleration of the ego", "m/s²", accelerations, StripScale(-1.0, 1.0)),
    )
    return tuple(
        charts.Chart(
            id=f"{name}-chart",
            kind="course",
            title=title,
            caption=caption,
            data={
                "axis": "Time [s]",
                "end": end_s,
                "time": dt_s * np.arange(len(values)),
                "unit": unit,
                "ticks": make_ticks(values, scale),
                "values": values,
            },
            table=charts.ChartTable(
                ("Time [s]", f"{title} [{unit}]"),
                [
                    (format_number(dt_s * step), format_number(float(value), 4))
                    for step, value in enumerate(values)
                ],
            ),
        )
        for (name, caption), (title, unit, values, scale) in zip(
            COURSE_CAPTIONS.items(), courses, strict=True
        )
    )


def find_nearest_moment(scene: Scene) -> float:
    """Return the time at which the ego was nearest to another vehicle [s]."""
    return float(footprints.measure_clearances(scene).min(axis=1).argmin()) * scene.dt_s


SCENE_COLUMNS = (
    "Time [s]",
    "Ego x [m]",
    "Ego y [m]",
    "Ego speed [m/s]",
    "Actor x [m]",
    "Actor y [m]",
    "Seen at x [m]",
    "Seen at y [m]",
    "Acceleration [m/s²]",
    "Distance [m]",
)


def make_scene_chart(
    scene: Scene, mission: Mission | None, outcome: Outcome, name: str = "scene"
) -> charts.Chart:
    """Return the chart of the episode from above, with the moment at which it ended."""
    nearest = find_nearest_actors(scene)
    apart = footprints.measure_clearances(scene).min(axis=1)
    return charts.Chart(
        id=name,
        kind="player",
        title="Scene from above",
        caption="Width and length have the same scale; the view follows the ego.",
        data={
            "dt": scene.dt_s,
            "vehicles": _round_places(scene.vehicles),
            "sizes": scene.sizes,
            "perceived": _round_places(scene.perceived),
            "nearest": nearest,
            "apart": apart,
            "collides": outcome is Outcome.COLLISION,
            "lanes": mission.lanes if mission else 0,
            "lane": mission.lane_width_m if mission else CONVENTIONAL_LANE_M,
            **_list_optional_values(scene),
        },
        table=charts.ChartTable(
            SCENE_COLUMNS,
            [make_scene_row(scene, step, actor, apart) for step, actor in enumerate(nearest)],
            ("The scene by step.",),
        ),
    )


def _round_places(places: Floats) -> list[object]:
    """Return places and headings as plain values, to a millimetre and a milliradian."""
    # With a number of significant digits, vehicles far from the origin would jump.
    rounded: list[object] = np.round(places.astype(np.float64), MILLIRADIAN).tolist()
    return rounded


def _list_optional_values(scene: Scene) -> dict[str, object]:
    """Return the borders of the lanes and the kinds of the vehicles, if the scene has them.

    A vehicle of an unknown kind has an empty text.
    """
    shown: dict[str, object] = {}
    # Only scenes of worlds with a map have borders of lanes; others draw straight ones.
    if not isinstance(scene.road, msgspec.UnsetType):
        shown["road"] = [_round_places(border) for border in scene.road]
    if not isinstance(scene.kinds, msgspec.UnsetType):
        shown["kinds"] = ["" if kind == UNKNOWN_KIND else kind for kind in scene.kinds]
    return shown


def find_nearest_actors(scene: Scene) -> list[int]:
    """Return for each step the vehicle whose centre is nearest to the ego's."""
    # In double precision, or vehicles at large coordinates would be equally near.
    places = scene.vehicles[:, :, :2].astype(np.float64)
    apart = np.hypot(*np.moveaxis(places[:, 1:] - places[:, :1], -1, 0))
    return [1 + int(nearest) for nearest in np.nanargmin(apart, axis=1)]


def make_scene_row(scene: Scene, step: int, actor: int, apart: Floats) -> tuple[str, ...]:
    """Return a step as text; the last step lacks perception and control."""
    ego, other = scene.vehicles[step, 0], scene.vehicles[step, actor]
    # The last state follows the last decision: nothing is perceived or steered there.
    is_over = step >= min(len(scene.perceived), len(scene.controls))
    asked = () if is_over else (*scene.perceived[step], scene.controls[step, 0])
    numbers = (step * scene.dt_s, ego[0], ego[1], ego[3], *other[:2])
    return (
        *(format_number(float(value), 4) for value in numbers),
        *(format_number(float(value), 4) for value in asked or (nan,) * 3),
        format_number(float(apart[step]), 4),
    )


WORDS = ("mode", "rule", "candidate", "override", "heeds")
FIGURES = ("gap_m", "closing_mps")


def make_account_view(explanation: Explanation, mission: Mission | None) -> dict[str, object]:
    """Return what the page of an episode shows of the planner's explanation."""
    same, scene = explanation.replayed.same, explanation.scene
    return {
        "explanation": explanation,
        # Of another course than the one that is shown the moments and steps would be wrong.
        "jumps": tuple(find_moments(explanation.steps)) if same else (),
        "steps": make_player_columns(explanation.steps) if same else None,
        "scene": make_scene_chart(scene, mission, explanation.replayed.outcome) if scene else None,
        "courses": make_course_charts(scene) if scene else (),
    }


def make_player_columns(steps: Sequence[ExplainedStep]) -> dict[str, object]:
    """Return columns with a value per step: texts, figures, and the path as flat (x, y, …)."""
    words = {name: [str(step.account.get(name, "")) for step in steps] for name in WORDS}
    words["heeds"] = [
        f"{word}, vehicle {step.vehicle}" if step.vehicle and word not in ("", "nobody") else word
        for word, step in zip(words["heeds"], steps, strict=True)
    ]
    figures = {
        name: charts.collect_floats(read_figure(step, name) for step in steps) for name in FIGURES
    }
    truth = {
        "true_gap_m": charts.collect_floats(step.gap_m for step in steps),
        "true_closing_mps": charts.collect_floats(step.closing_mps for step in steps),
    }
    paths = [np.ravel(step.path) for step in steps]
    return {**words, **figures, **truth, "path": paths}


def read_figure(step: ExplainedStep, name: str) -> float | None:
    """Return a figure of the explanation; None if it has none of that name."""
    value = step.account.get(name)
    # A planner may report anything under any name.
    return value if isinstance(value, float) else None


CENTIMETRE, MILLIRADIAN = 2, 3
"""Decimals of positions and headings: finer than a screen shows."""

TABLE_STEP_S = 0.5
"""Time between two rows of the table. [s]"""

MOST_TABLE_ROWS = 60
"""Rows of the table at most; of longer episodes it has fewer moments."""


def describe_first(recordings: OverlaidRecordings) -> str:
    """Return which failure is opaque: the medoid, or an episode if the medoid lacks a scene."""
    campaign, index = recordings.episodes[0]
    return "the medoid" if recordings.has_medoid else f"episode {campaign}/{index}"


def make_overlay_chart(recordings: OverlaidRecordings, name: str) -> charts.Chart:
    """Return the courses of episodes over each other, and a table of them by time."""
    failures = [_Failure(scene) for scene in recordings.scenes]
    mission, first = recordings.mission, describe_first(recordings)
    data: dict[str, object] = {
        "dt": recordings.scenes[0].dt_s,
        "last": max(each.last for each in failures),
        "lanes": mission.lanes if mission else 0,
        "lane": mission.lane_width_m if mission else CONVENTIONAL_LANE_M,
        "failures": [
            {
                "episode": f"{campaign}/{index}",
                "collides": outcome is Outcome.COLLISION,
                **failure.list_values(),
            }
            for failure, outcome, (campaign, index) in zip(
                failures, recordings.outcomes, recordings.episodes, strict=True
            )
        ],
    }
    road = recordings.scenes[0].road
    if not isinstance(road, msgspec.UnsetType):
        data["road"] = road
    return charts.Chart(
        id=name,
        kind="overlay",
        title="Failures over each other",
        caption=f"From above. {first[0].upper()}{first[1:]} is opaque, the other failures are"
        " translucent.",
        data=data,
        table=charts.ChartTable(
            (
                "Time before the end [s]",
                "Failures under way",
                "Ego speed, median [m/s]",
                "Smallest [m/s]",
                "Largest [m/s]",
                "Distance, median [m]",
                "Smallest [m]",
                "Largest [m]",
            ),
            list(_list_overlay_rows(failures, recordings.scenes[0].dt_s)),
            ("Speed of the ego and distance to the nearest vehicle, by time before the end.",),
        ),
    )


class _Failure:
    """Course of one failure: poses, speed of the ego, distance to the nearest vehicle."""

    def __init__(self, scene: Scene) -> None:
        self.last = len(scene.vehicles) - 1
        self.speed_mps = scene.vehicles[:, 0, 3].astype(np.float64)
        # An ego alone is apart from nothing.
        has_others = len(scene.sizes) > 1
        apart_m = (
            footprints.measure_clearances(scene) if has_others else np.empty((self.last + 1, 0))
        )
        self.apart_m = apart_m.min(axis=1, initial=inf)
        self.struck = footprints.find_struck(scene) if has_others else 0
        self._scene = scene

    def list_values(self) -> dict[str, object]:
        """Return the values for the player; a track is x, y, heading, x, y, heading, and so on."""
        poses = self._scene.vehicles[..., :3].astype(np.float64)
        # Rounded, or each of the many numbers would be written with all digits of a float.
        poses[..., :2] = poses[..., :2].round(CENTIMETRE)
        poses[..., 2] = poses[..., 2].round(MILLIRADIAN)
        return {
            "last": self.last,
            "struck": self.struck,
            "sizes": self._scene.sizes,
            "tracks": [track.ravel().tolist() for track in poses.swapaxes(0, 1)],
            "speed": self.speed_mps,
            "apart": self.apart_m,
        }


def _list_overlay_rows(failures: Sequence[_Failure], dt_s: float) -> Iterator[tuple[str, ...]]:
    last = max(failure.last for failure in failures)
    # Counted from the end, where failures are aligned, so that rows of all lengths match.
    every = max(1, round(TABLE_STEP_S / dt_s), ceil(last / MOST_TABLE_ROWS))
    for before in range(last // every * every, -1, -every):
        under_way = [failure for failure in failures if failure.last >= before]
        speeds = [failure.speed_mps[failure.last - before] for failure in under_way]
        distances = [failure.apart_m[failure.last - before] for failure in under_way]
        yield (
            format_number(before * dt_s),
            str(len(under_way)),
            *_summarise(speeds),
            *_summarise([each for each in distances if each < inf]),
        )


def _summarise(values: Sequence[float]) -> tuple[str, str, str]:
    """Return median, smallest and largest value as text."""
    if not values:
        return (UNKNOWN,) * 3
    found = float(np.median(values)), min(values), max(values)
    median, smallest, largest = (format_number(each) for each in found)
    return median, smallest, largest
