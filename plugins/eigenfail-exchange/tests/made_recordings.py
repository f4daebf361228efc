"""Recordings of made-up drives."""

import numpy as np

from eigenfail.contracts.recording import EpisodeRecording
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import Outcome
from eigenfail.values.scene import Mission, Scene

STEPS = 12


def drive(steps=STEPS, dt_s=0.1, seed=0):
    """A scene of a truck, a car, and a car that comes, goes and comes back."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(steps + 1) * dt_s
    vehicles = np.empty((steps + 1, 3, 4))
    for number in range(3):
        speed, heading = rng.uniform(15.0, 30.0), rng.uniform(-0.3, 0.3)
        vehicles[:, number, 0] = rng.uniform(-400.0, 4000.0) + speed * np.cos(heading) * time_s
        vehicles[:, number, 1] = 3.5 * (number % 2) + speed * np.sin(heading) * time_s
        vehicles[:, number, 2], vehicles[:, number, 3] = heading, speed
    vehicles[[step for step in (0, 1, 5, 6, steps) if step <= steps], 2] = np.nan
    return Scene(
        dt_s=dt_s,
        vehicles=vehicles.astype(np.float32),
        sizes=np.array([[16.0, 2.5], [5.0, 2.0], [4.5, 1.8]], np.float32),
        perceived=rng.normal(size=(steps, 2)).astype(np.float32),
        controls=rng.normal(size=(steps, 2)).astype(np.float32),
    )


def record(scene=None, outcome=Outcome.COLLISION, mission=None):
    """The recording of a scene."""
    scene = drive() if scene is None else scene
    z = np.random.default_rng(1).normal(size=(len(scene.vehicles) - 1, 2)).astype(np.float32)
    return EpisodeRecording(
        campaign=2,
        campaign_name='a "name" & <another>',
        index=7,
        recorded_ms=1_790_000_000_000,
        scenario="cut_in",
        planner="my<module>:Planner",
        seed=5,
        outcome=outcome,
        digest="0" * 64,
        noise=NoiseTrajectory(z, np.full_like(z, 2.0)),
        channels=("longitudinal", "lateral"),
        scene=scene,
        mission=mission,
    )


MISSION = Mission(0.1, 2, 3.5, 25.0, 24.0, 1000.0, lane_0_ends_x_m=900.0)
"""Two lanes, the right one of which ends."""
