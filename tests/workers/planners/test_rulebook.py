"""The whole planner on the real simulator: calm, deterministic, and wrong in one way only."""

from itertools import product

import numpy as np
import pytest
from msgspec import structs

from eigenfail.values import Perception
from eigenfail_workers.planners.rulebook.overrides import Override
from eigenfail_workers.planners.rulebook.planner import Rulebook
from eigenfail_workers.planners.rulebook.quadratic_program import QpStatus, SolverSettings
from eigenfail_workers.planners.rulebook.refine import RefineSettings
from eigenfail_workers.scenarios.cut_in import CutIn

BOUNDS = {
    "distance_m": (48.0, 58.0, 70.0),
    "initial_gap_m": (80.0, 120.0),
    "ego_speed_mps": (22.0, 25.0),
    "actor_speed_mps": (11.0, 16.0),
    "lane_change_s": (5.0, 9.0),
}
STEPS = 100


def slow_square(half_period=16, amplitude=3.0):
    """±3 sigma on both axes: no single value is out of the ordinary."""
    sign = np.where((np.arange(STEPS) // half_period) % 2 == 0, 1.0, -1.0)
    return amplitude * np.stack([sign, sign], axis=1)


def share(results):
    results = list(results)
    return float(np.mean([result.is_failure for result in results]))


@pytest.fixture
def watched(mission):
    """Drive a planner through the cut-in with straight-line kinematics; its decisions."""

    def run(planner, z=None, steps=STEPS):
        now = CutIn()(CutIn.Parameters(), 0)
        noise = np.zeros((steps, 2)) if z is None else z
        ego, decisions = now.ego, []
        planner.reset(now.mission)
        for step in range(steps):
            car = now.move_actor(0, step, ego)
            seen = structs.replace(
                car, x_m=car.x_m + 2.0 * noise[step, 0], y_m=car.y_m + 0.21 * noise[step, 1]
            )
            control = planner.act(Perception(step * 0.1, ego, (seen,)))
            decisions.append(planner.last_decision)
            speed = max(ego.speed_mps + 0.1 * control.acceleration_mps2, 0.0)
            ego = structs.replace(ego, x_m=ego.x_m + 0.1 * ego.speed_mps, speed_mps=speed)
        return decisions

    return run


@pytest.mark.parametrize("parameters", [dict(zip(BOUNDS, v)) for v in product(*BOUNDS.values())])  # noqa: B905
def test_undisturbed_it_is_a_calm_driver_everywhere_in_the_bounds(drive, parameters):
    result = drive(**parameters)
    acceleration = result.scene.controls[:, 0]
    assert not result.is_failure
    assert result.measures.robustness_m > 1.0
    assert acceleration.min() > -2.5
    assert np.abs(np.diff(acceleration)).max() <= 0.4 + 1e-6
    assert result.scene.vehicles[-1, 0, 3] > 9.0


@pytest.mark.parametrize("closing", [0.0, 3.0])
def test_the_baseline_is_safe_undisturbed_from_the_default_distance_on(drive, closing):
    for distance_m in (58.0, 63.0, 70.0):
        result = drive(planner="idm", distance_m=distance_m, actor_speed_mps=12.0 + closing)
        assert not result.is_failure


def test_undisturbed_nothing_overrides_and_every_step_is_explained(watched):
    decisions = watched(Rulebook(Rulebook.Settings()))
    assert {d.override for d in decisions} == {Override.NONE}
    assert {d.qp_status for d in decisions} == {QpStatus.SOLVED}
    assert [d.candidate for d in decisions if d.around.lead] != []
    order = list(dict.fromkeys(d.candidate for d in decisions))
    assert order.index("keep") < order.index("slow") < order.index("follow")
    assert decisions[-1].lost_tracks == 0


def test_an_episode_does_not_depend_on_those_before_it(watched):
    planner = Rulebook(Rulebook.Settings())
    z = np.random.default_rng(1).normal(size=(STEPS, 2))
    first = watched(planner, z)
    watched(planner, slow_square())
    watched(planner, z[::-1], steps=37)
    assert watched(planner, z) == first
    assert watched(Rulebook(Rulebook.Settings()), z) == first


def test_a_program_that_never_converges_is_replaced_by_the_fallback(watched):
    hasty = SolverSettings(max_iterations=1, check_every=1, tolerance=1e-9)
    settings = Rulebook.Settings(refine=RefineSettings(solver=hasty))
    decisions = watched(Rulebook(settings))
    assert {d.qp_status for d in decisions} == {QpStatus.ITERATION_LIMIT}
    assert {d.override for d in decisions} <= {Override.QP_FALLBACK, Override.EMERGENCY_BRAKE}
    assert max(d.acceleration_mps2 for d in decisions) <= 0.0
    assert min(d.acceleration_mps2 for d in decisions) < -0.5


def test_a_position_of_nan_is_an_outlier_like_any_other(watched):
    z = np.zeros((STEPS, 2))
    z[:2] = z[40:43] = np.nan
    decisions = watched(Rulebook(Rulebook.Settings()), z)
    assert decisions[1].tracks == ()
    assert decisions[42].tracks == ("coasting",)
    assert all(np.isfinite(d.acceleration_mps2) for d in decisions)


def test_the_crash_is_reachable_by_shape_and_not_by_values(drive):
    """A slow longitudinal wave of ±2 sigma crashes it; its values shuffled in time seldom do."""
    wave = 2.0 / 3.0 * slow_square(half_period=20) * (1.0, 0.0)
    shaped = drive(wave)
    assert shaped.is_failure
    assert shaped.measures.severity > 60.0
    assert np.abs(shaped.noise.z).max() <= 2.0
    rng = np.random.default_rng(11)
    shuffled = [drive(rng.permutation(wave)) for _ in range(40)]
    assert share(shuffled) <= 0.2
    white = [drive(rng.normal(size=(STEPS, 2))) for _ in range(60)]
    assert share(white) == 0.0


@pytest.mark.parametrize("offset_m", [-5.0, 0.0, 5.0])
def test_shaped_noise_crashes_it_at_neighbouring_distances_too(drive, offset_m):
    waves = [slow_square(half_period) for half_period in range(8, 21, 2)]
    assert share([drive(z, distance_m=58.0 + offset_m) for z in waves]) >= 0.8


def test_noise_that_is_held_crashes_it_more_often_than_white_noise_of_the_same_values(drive):
    rng = np.random.default_rng(12)
    white = [rng.uniform(-3, 3, (STEPS, 2)) for _ in range(40)]
    held = [np.repeat(z[::5], 5, axis=0) for z in white]
    assert share(map(drive, held)) >= share(map(drive, white)) + 0.25
