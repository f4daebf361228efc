"""One episode: facts, noise, and the scene from above."""

import msgspec
import numpy as np

from eigenfail.values import Campaign, EpisodeResult, Mission, NoiseTrajectory, Scene
from eigenfail.variations import drawn_for
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.charts import Chart, rounded, rounded_rows
from eigenfail_api.dashboard.views.measured import Facts, facts, ride
from eigenfail_api.dashboard.views.states import OUTCOME_BADGES, Badge

CONVENTIONAL_LANE_M = 3.5


class EpisodeView(msgspec.Struct, frozen=True, kw_only=True):
    """The page of an episode.

    Attributes:
        facts: what the episode was.
        varied: the scenario parameters that it drew; empty where they are fixed.
        ride: when thresholds were passed, and how rough it was; empty if not measured.
        next_failure: index of the next collision of the campaign, if there is one.
    """

    campaign: int
    campaign_name: str
    index: int
    badge: Badge
    facts: Facts
    varied: Facts
    ride: Facts
    problem: str
    digest: str
    noise: Chart | None
    scene: Chart | None
    next_failure: int | None


def episode_view(
    campaign: Campaign, result: EpisodeResult, mission: Mission | None, next_failure: int | None
) -> EpisodeView:
    """The page of an episode; the mission, where the scenario could tell it, gives the lanes."""
    fault = result.fault
    dt_s = result.scene.dt_s if result.scene else mission.dt_s if mission else None
    return EpisodeView(
        campaign=campaign.id,
        campaign_name=campaign.spec.name,
        index=result.index,
        badge=OUTCOME_BADGES[result.outcome],
        facts=facts(result, dt_s),
        varied=varied(campaign, result),
        ride=ride(result),
        problem=f"{fault.kind}: {fault.message}" if fault else "",
        digest=result.digest(),
        noise=noise_chart(result.noise, dt_s) if result.steps else None,
        scene=scene_chart(result.scene, mission) if result.scene else None,
        next_failure=next_failure,
    )


def varied(campaign: Campaign, result: EpisodeResult) -> Facts:
    """The scenario parameters that the episode drew from its own seed."""
    drawn = drawn_for(campaign.spec, result.seed)
    return tuple((name, str(value)) for name, value in drawn.items())


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


def scene_chart(scene: Scene, mission: Mission | None) -> Chart:
    """The course of the episode, from above."""
    nearest = nearest_actor(scene)
    return Chart(
        id="scene",
        kind="player",
        title="Scene from above",
        caption=(
            "Ego solid, others outlined, dashed where the ego saw the nearest one. Width and "
            "length are to the same scale."
        ),
        data={
            "dt": scene.dt_s,
            "vehicles": [rounded_rows(vehicles) for vehicles in scene.vehicles],
            "sizes": rounded_rows(scene.sizes),
            "perceived": rounded_rows(scene.perceived),
            "nearest": nearest,
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
        ),
        rows=tuple(scene_row(scene, step, nearest[step]) for step in range(len(scene.perceived))),
    )


def nearest_actor(scene: Scene) -> list[int]:
    """At each moment, the vehicle whose centre is nearest to the ego's."""
    places = scene.vehicles[:, :, :2].astype(np.float64)
    apart = np.hypot(*np.moveaxis(places[:, 1:] - places[:, :1], -1, 0))
    return [1 + int(nearest) for nearest in apart.argmin(axis=1)]


def scene_row(scene: Scene, step: int, actor: int) -> tuple[str, ...]:
    """One step as text."""
    ego, other = scene.vehicles[step, 0], scene.vehicles[step, actor]
    numbers = (
        step * scene.dt_s,
        *(ego[0], ego[1], ego[3]),
        *other[:2],
        *scene.perceived[step],
        scene.controls[step, 0],
    )
    return tuple(formats.number(float(value), 4) for value in numbers)
