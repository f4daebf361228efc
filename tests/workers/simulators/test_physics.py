"""What the two simulators do with a truck: closed forms, and each other."""

import subprocess
import sys
from collections.abc import Sequence
from itertools import pairwise
from math import atan, pi, sin, tan
from typing import Any

import msgspec
import pytest

from eigenfail import plugins
from eigenfail.values import Control, Mission, Observation, Perception

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
    simulation = simulator.open(scenario, scenario.Parameters(**parameters), Plan(controls))
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
def test_no_truck_steers_or_brakes_beyond_its_limits(name: str, small_cut_in: Any) -> None:
    wild = driven(name, small_cut_in, Control(-1e300, 1e6))
    limit = driven(name, small_cut_in, Control(-7.0, pi / 4))
    assert [o.ego for o in wild] == [o.ego for o in limit]
    assert wild[1].control == Control(-1e300, 1e6)
    assert wild[1].applied == limit[1].applied == limit[1].control


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
def test_a_steady_truck_hits_a_slower_car_when_the_gap_is_used_up(
    name: str, small_cut_in: Any
) -> None:
    seen = driven(name, small_cut_in, Control(0.0, 0.0), gap_m=30.0, slower_mps=8.0)
    # 30 m at 8 m/s are used up after 3.75 s, which step 38 sees
    assert [o.collided for o in seen] == [False] * 38 + [True]


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


def test_scenarios_do_not_need_highway_env() -> None:
    code = (
        "import sys, eigenfail_workers.engine, eigenfail_workers.scenarios,"
        " eigenfail_workers.simulators.point_mass;"
        " sys.exit('highway_env' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_simulator_loads_no_environments_and_leaves_highway_env_whole() -> None:
    code = (
        "import sys, eigenfail_workers.simulators.highway;"
        " assert not {'highway_env', 'gymnasium', 'pandas', 'matplotlib'} & sys.modules.keys();"
        " import gymnasium, highway_env, highway_env.road.road as road;"
        " assert highway_env.road.road.Road is road.Road;"
        " assert gymnasium.spec('highway-v0').id"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
