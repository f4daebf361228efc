"""The steps of an episode as a table in a file."""

import csv
import io
from collections.abc import Iterator

from eigenfail.tabulation import Record, records
from eigenfail.values import AXES, EpisodeResult, Scene
from eigenfail_services.analysis.clearance import clearances

NOISE = (
    "step",
    *(f"{axis}_{quantity}" for quantity in ("z", "sigma_m", "m") for axis in AXES),
    "log_probability",
)
"""What `NoiseTrajectory.to_pandas` calls it, too."""

CONTROLS = ("acceleration_mps2", "steering_rad", "perceived_x_m", "perceived_y_m", "clearance_m")
STATE = ("x_m", "y_m", "heading_rad", "speed_mps")


def steps_csv(result: EpisodeResult) -> str:
    """One row for each step: the noise; where the scene was kept, all vehicles when it began."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    scene = result.scene
    writer.writerow((*NOISE, *(columns(scene) if scene else ())))
    rows = scene_rows(scene) if scene else iter([()] * result.steps)
    told = noise_rows(result)
    writer.writerows(
        (*(row[name] for name in NOISE), *more) for row, more in zip(told, rows, strict=True)
    )
    return text.getvalue()


def noise_rows(result: EpisodeResult) -> Iterator[Record]:
    """What was injected, and how likely it was."""
    likely = result.noise.log_probability_per_step
    for row, log_p in zip(records(result.noise), likely, strict=True):
        yield {**row, "log_probability": float(log_p)}


def columns(scene: Scene) -> Iterator[str]:
    """Names of what a scene adds: time, controls, and the state of each vehicle."""
    yield from ("time_s", *CONTROLS)
    for number in range(len(scene.sizes)):
        who = "ego" if number == 0 else f"vehicle_{number}"
        yield from (f"{who}_{name}" for name in STATE)


def scene_rows(scene: Scene) -> Iterator[tuple[float, ...]]:
    """What they hold."""
    apart = clearances(scene).min(axis=1)
    for step, (control, seen) in enumerate(zip(scene.controls, scene.perceived, strict=True)):
        states = scene.vehicles[step].ravel()
        yield tuple(map(float, (step * scene.dt_s, *control, *seen, apart[step], *states)))
