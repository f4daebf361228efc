"""What the two simulators do with a truck: closed forms, and each other."""

from collections.abc import Sequence
from itertools import pairwise
from math import atan, pi, sin, tan
from typing import Any

import msgspec
import numpy as np
import pytest

from eigenfail import plugins
from eigenfail.values.disturbance import POSITION
from eigenfail.values.scene import Control, Mission, Observation, Perception, VehicleState
from eigenfail_workers.measures.geometry import separation
from eigenfail_workers.scenarios.cut_in import CutIn
from eigenfail_workers.simulators import highway

BUILT_IN = ("highway", "point_mass")


class Plan:
    """Drives by a list of controls, and goes on with the last one."""

    def __init__(self, controls: Sequence[Control]) -> None:
        self.controls = controls

    def reset(self, mission: Mission) -> None:
        self.left = list(self.controls)

    def act(self, perception: Perception) -> Control:
        return self.left.pop(0) if len(self.left) > 1 else self.left[0]


def driven(name: str, scenario: Any, *controls: Control, **parameters: float) -> list[Observation]:
    simulator = plugins.load(plugins.SIMULATORS, name)()
    simulation = simulator.open(
        scenario, scenario.Parameters(**parameters), Plan(controls), POSITION
    )
    seen = [simulation.reset(0)]
    while not seen[-1].ended:
        seen.append(simulation.step((0.0, 0.0)))
    return seen


@pytest.mark.parametrize("name", BUILT_IN)
def test_braking_is_explicit_euler_and_ends_at_rest(name: str, small_cut_in: Any) -> None:
    seen = driven(name, small_cut_in, Control(-6.0, 0.0), gap_m=90.0)
    # from 20 m/s at 6 m/s², dt 0.1 s: 20 + 19.4 + … + 0.2 m/s over 34 steps
    assert seen[33].ego.speed_mps == pytest.approx(0.2)
    assert seen[34].ego.speed_mps == seen[-1].ego.speed_mps == 0.0
    assert seen[-1].ego.x_m == pytest.approx(0.1 * 34 * (20.0 + 0.2) / 2.0)
    assert seen[-1].ego.y_m == 0.0


@pytest.mark.parametrize("name", BUILT_IN)
def test_steering_turns_as_the_bicycle_does(name: str, small_cut_in: Any) -> None:
    seen = driven(name, small_cut_in, Control(0.0, -0.02), gap_m=90.0)
    slip = atan(0.5 * tan(-0.02))
    rate = 20.0 * sin(slip) / 8.0
    assert seen[30].ego.heading_rad == pytest.approx(rate * 3.0)
    assert seen[1].ego.y_m == pytest.approx(2.0 * sin(slip))
    assert seen[30].ego.y_m < -2.0


@pytest.mark.parametrize("name", BUILT_IN)
def test_no_truck_accelerates_beyond_its_power(name: str, small_cut_in: Any) -> None:
    seen = driven(name, small_cut_in, Control(9.0, 0.0), gap_m=120.0, slower_mps=-5.0)
    speeds = [o.ego.speed_mps for o in seen]
    # 400 kW at 20 m/s move 30 t by 2/3 m/s²
    assert speeds[1] == pytest.approx(20.0 + 0.1 * 400.0 / (30.0 * 20.0))
    # Explicit Euler gives a little more kinetic energy than the engine's work.
    for before, after in pairwise(speeds):
        watts = 30_000.0 * (after**2 - before**2) / 2.0 / 0.1
        assert watts == pytest.approx(400_000.0, rel=2e-3)


@pytest.mark.parametrize("name", BUILT_IN)
def test_no_truck_brakes_harder_than_its_scenario_says(name: str) -> None:
    for parameters, peak_mps2 in (({}, 7.0), ({"peak_braking_mps2": 3.2}, 3.2)):
        seen = driven(name, CutIn(), Control(-9.0, 0.0), **parameters)
        assert seen[1].ego.speed_mps == pytest.approx(24.0 - 0.1 * peak_mps2)
        assert seen[1].applied == Control(-peak_mps2, 0.0)
        assert seen[0].peak_braking_mps2 == peak_mps2


CONTROLS = (
    (Control(0.0, 0.0),),
    (Control(-2.0, 0.0),),
    (Control(1.5, 0.01), Control(-4.0, -0.02)),
    (Control(0.0, 0.03),),
)


@pytest.mark.parametrize("controls", CONTROLS)
@pytest.mark.parametrize("gap_m", [-5.0, 30.0, 60.0])
def test_the_two_simulators_agree(
    controls: tuple[Control, ...], gap_m: float, small_cut_in: Any
) -> None:
    both = [driven(name, small_cut_in, *controls, gap_m=gap_m) for name in BUILT_IN]
    assert len(both[0]) == len(both[1])
    for one, other in zip(*both, strict=True):
        assert (one.collided, one.ended, one.others) == (other.collided, other.ended, other.others)
        poses = [msgspec.structs.astuple(o.ego) for o in (one, other)]
        assert poses[0] == pytest.approx(poses[1], abs=1e-9)


@pytest.mark.parametrize("name", BUILT_IN)
def test_a_crash_from_the_side_is_seen(name: str, small_cut_in: Any) -> None:
    last = driven(name, small_cut_in, Control(0.0, 0.03), gap_m=-5.0)[-1]
    assert last.collided
    assert abs(last.others[0].x_m - last.ego.x_m) < 8.0
    assert 2.0 < last.others[0].y_m - last.ego.y_m < 2.8


@pytest.fixture(scope="module")
def vehicle_class() -> Any:
    """highway-env's vehicle, without its search for lanes, which needs a road."""
    from highway_env.vehicle.kinematics import Vehicle

    class Truck(Vehicle):  # type: ignore[misc]
        LENGTH, WIDTH = 16.0, 2.5

        def on_state_update(self) -> None:
            """Stay without a lane."""

    return Truck


def random_states(count: int, spread_m: float, seed: int) -> list[VehicleState]:
    """Trucks anywhere within a square, in any direction, at up to 60 m/s."""
    low, high = (-spread_m, -spread_m, -pi, 0.0), (spread_m, spread_m, pi, 60.0)
    rows = np.random.default_rng(seed).uniform(low, high, (count, 4))
    return [VehicleState(*row, 16.0, 2.5) for row in rows.tolist()]


def make_vehicle(vehicle_class: Any, state: VehicleState) -> Any:
    return vehicle_class(None, (state.x_m, state.y_m), state.heading_rad, state.speed_mps)


def test_highway_drives_as_highway_env_does_to_the_last_bit(vehicle_class: Any) -> None:
    controls = np.random.default_rng(1).uniform((-7.0, -pi / 4), (1.5, pi / 4), (5000, 2))
    for state, control in zip(random_states(5000, 1e3, 2), controls.tolist(), strict=True):
        there = make_vehicle(vehicle_class, state)
        there.act({"acceleration": control[0], "steering": control[1]})
        there.step(0.1)
        speed_mps = max(there.speed, 0.0)
        expected = VehicleState(*there.position, there.heading, speed_mps, 16.0, 2.5)
        assert highway.drive(state, Control(*control), 0.1) == expected


def test_a_collision_is_one_of_highway_env(vehicle_class: Any) -> None:
    def touch(one: VehicleState, other: VehicleState) -> bool:
        vehicles = [make_vehicle(vehicle_class, state) for state in (one, other)]
        vehicles[0].handle_collisions(vehicles[1], dt=0)
        return bool(vehicles[0].crashed)

    states = random_states(4000, 12.0, 3)
    pairs = list(zip(states[::2], states[1::2], strict=True))
    found = [separation(*pair).distance_m == 0.0 for pair in pairs]
    assert found == [touch(*pair) for pair in pairs]
    assert 200 < sum(found) < 1800
