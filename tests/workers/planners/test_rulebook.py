"""The whole planner on the real simulator: calm, deterministic, and wrong in one way only."""

import numpy as np
import pytest
from msgspec import structs

from eigenfail.values.scene import Perception
from eigenfail_workers.planners.rulebook.planner import Rulebook
from eigenfail_workers.planners.rulebook.settings import RefineSettings, SolverSettings
from eigenfail_workers.planners.rulebook.values import Override, QpStatus
from eigenfail_workers.scenarios.cut_in import CutIn

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
            control = planner.act(Perception(step * 0.1, ego, (seen,), (1,)))
            decisions.append(planner.last_decision)
            speed = max(ego.speed_mps + 0.1 * control.acceleration_mps2, 0.0)
            ego = structs.replace(ego, x_m=ego.x_m + 0.1 * ego.speed_mps, speed_mps=speed)
        return decisions

    return run


def test_undisturbed_nothing_overrides_and_every_step_is_explained(watched):
    decisions = watched(Rulebook(Rulebook.Settings()))
    assert {d.override for d in decisions} == {Override.NONE}
    assert {d.qp_status for d in decisions} == {QpStatus.SOLVED}
    assert [d.candidate for d in decisions if d.traffic.lead] != []
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


@pytest.mark.parametrize("offset_m", [-5.0, 0.0, 5.0])
def test_shaped_noise_crashes_it_at_neighbouring_distances_too(drive, offset_m):
    waves = [slow_square(half_period) for half_period in range(8, 21, 2)]
    assert share([drive(z, distance_m=58.0 + offset_m) for z in waves]) >= 0.8
