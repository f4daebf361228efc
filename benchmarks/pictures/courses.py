"""Runs to be drawn."""

from math import isfinite
from typing import NamedTuple

import numpy as np
from benchmarks.episode_pool import make_setup
from benchmarks.truth.shapes import square_wave

from eigenfail import plugins
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import EpisodeTask, PriorSource, TrajectorySource
from eigenfail.values.proof import ExplainedEpisode
from eigenfail.values.scene import Mission, Scene, VehicleState
from eigenfail_workers.explain import explain

NOISY_SEED = 1
SILENCE = np.zeros((0, 2))
WAVE_SIGMA, WAVE_HALF_PERIOD = 2.0, 20


class Course(NamedTuple):
    """A run of `rulebook` without noise, and the noise of another run in the same scenario."""

    mission: Mission
    scene: Scene
    noise: NoiseTrajectory

    @property
    def last_step(self) -> int:
        """The number of the last step."""
        return len(self.scene.controls)

    def vehicles(self, step: int) -> list[VehicleState]:
        """All that are there after a step, the truck first."""
        poses = zip(self.scene.vehicles[step].tolist(), self.scene.sizes.tolist(), strict=True)
        return [VehicleState(*pose, *size) for pose, size in poses if isfinite(pose[0])]


def course(scenario: str) -> Course:
    """The course of a scenario at its defaults."""
    plugin = plugins.load(plugins.SCENARIOS, scenario)
    calm = run_with_noise(scenario, SILENCE).result
    noisy = explain(
        make_setup(scenario, "rulebook"), EpisodeTask(0, NOISY_SEED, PriorSource())
    ).result
    if calm.scene is None:
        raise SystemExit(f"{scenario} cannot be run: {calm.fault}.")
    return Course(plugin()(plugin.Parameters(), 0).mission, calm.scene, noisy.noise)


def crash() -> ExplainedEpisode:
    """A run on cut_in under a slow longitudinal wave."""
    found = run_with_noise("cut_in", square_wave(100, WAVE_SIGMA, WAVE_HALF_PERIOD))
    if not found.result.is_failure:
        raise SystemExit("The slow wave no longer makes it collide: choose another one.")
    return found


def run_with_noise(scenario: str, z: np.ndarray) -> ExplainedEpisode:
    """`rulebook` under this noise, shape (steps, 2)."""
    source = TrajectorySource(z.astype(np.float32))
    return explain(make_setup(scenario, "rulebook"), EpisodeTask(0, 0, source))
