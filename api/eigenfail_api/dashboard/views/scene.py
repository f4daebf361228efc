"""The course of an episode from above, and the strips below it that share its time."""

from math import nan

import numpy as np

from eigenfail.values import Floats, Mission, NoiseTrajectory, Outcome, Scene
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.charts import Chart, rounded, rounded_rows
from eigenfail_services.analysis.clearance import clearances

CONVENTIONAL_LANE_M = 3.5


def noise_chart(noise: NoiseTrajectory, dt_s: float | None) -> Chart:
    """What was added to the perceived position, step by step."""
    metres, standardised = noise.metres, noise.standardised
    times = [step * (dt_s or 1.0) for step in range(len(noise.z))]
    axis = "Time [s]" if dt_s else "Step"
    return Chart(
        id="noise-chart",
        kind="noise",
        title="Noise on the perceived position",
        caption=(
            "In standard deviations of the disturbance model "
            f"({noise.shape.in_words()}); the band is ±2 sigma."
        ),
        data={
            "axis": axis,
            "end": len(times) * (dt_s or 1.0),
            "time": rounded(times),
            "longitudinal": rounded(map(float, standardised[:, 0])),
            "lateral": rounded(map(float, standardised[:, 1])),
        },
        columns=(
            axis,
            "Longitudinal [sigma]",
            "Lateral [sigma]",
            "Longitudinal [m]",
            "Lateral [m]",
            "log p",
        ),
        rows=tuple(
            tuple(map(formats.number, map(float, (at, *u, *a, log_p))))
            for at, u, a, log_p in zip(
                times, standardised, metres, noise.log_probability_per_step, strict=True
            )
        ),
    )


def clearance_chart(scene: Scene) -> Chart:
    """How far the nearest vehicle was; the smallest of it is the robustness."""
    nearest = clearances(scene).min(axis=1)
    times = [step * scene.dt_s for step in range(len(nearest))]
    return Chart(
        id="clearance-chart",
        kind="clearance",
        title="Distance to the nearest vehicle",
        caption="Between the footprints [m]: its smallest value is the robustness of the episode.",
        data={
            "axis": "Time [s]",
            "end": times[-1],
            "time": rounded(times),
            "metres": rounded(map(float, nearest)),
        },
        columns=("Time [s]", "Distance [m]"),
        rows=tuple(
            (formats.number(at), formats.number(float(apart), 4))
            for at, apart in zip(times, nearest, strict=True)
        ),
    )


def nearest_moment(scene: Scene) -> float:
    """When the ego was nearest to any other vehicle [s]."""
    return float(clearances(scene).min(axis=1).argmin()) * scene.dt_s


def scene_chart(
    scene: Scene, mission: Mission | None, outcome: Outcome, name: str = "scene"
) -> Chart:
    """The course of the episode, from above, with the moment at which it ended."""
    nearest = nearest_actor(scene)
    apart = clearances(scene).min(axis=1)
    return Chart(
        id=name,
        kind="player",
        title="Scene from above",
        caption="Width and length are to the same scale; the view follows the ego.",
        data={
            "dt": scene.dt_s,
            "vehicles": [rounded_rows(vehicles) for vehicles in scene.vehicles],
            "sizes": rounded_rows(scene.sizes),
            "perceived": rounded_rows(scene.perceived),
            "nearest": nearest,
            "apart": rounded(map(float, apart)),
            "collides": outcome is Outcome.COLLISION,
            "lanes": mission.lanes if mission else 0,
            "lane": mission.lane_width_m if mission else CONVENTIONAL_LANE_M,
        },
        columns=(
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
        ),
        rows=tuple(
            scene_row(scene, step, nearest[step], apart) for step in range(len(scene.vehicles))
        ),
        note="The scene, step by step.",
    )


def nearest_actor(scene: Scene) -> list[int]:
    """At each moment, the vehicle whose centre is nearest to the ego's."""
    places = scene.vehicles[:, :, :2].astype(np.float64)
    apart = np.hypot(*np.moveaxis(places[:, 1:] - places[:, :1], -1, 0))
    return [1 + int(nearest) for nearest in apart.argmin(axis=1)]


def scene_row(scene: Scene, step: int, actor: int, apart: Floats) -> tuple[str, ...]:
    """One moment as text; in the last one nothing is perceived or done any more."""
    ego, other = scene.vehicles[step, 0], scene.vehicles[step, actor]
    is_over = step >= min(len(scene.perceived), len(scene.controls))
    asked = () if is_over else (*scene.perceived[step], scene.controls[step, 0])
    numbers = (step * scene.dt_s, ego[0], ego[1], ego[3], *other[:2])
    return (
        *(formats.number(float(value), 4) for value in numbers),
        *(formats.number(float(value), 4) for value in asked or (nan,) * 3),
        formats.number(float(apart[step]), 4),
    )
