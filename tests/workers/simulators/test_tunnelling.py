"""Contacts between two samples: the same outcome whatever the step is."""

from math import pi

import msgspec
import pytest

from eigenfail import plugins
from eigenfail.settings import read_settings
from eigenfail.testing.simulation import Cruise
from eigenfail.values.disturbance import POSITION
from eigenfail.values.measures import Measures
from eigenfail.values.scene import Mission, Observation, VehicleState
from eigenfail_workers.measures.recorder import Recorder

SIMULATORS = ("highway", "point_mass")


class Oncoming:
    """A truck at 25 m/s, and a car that comes towards it at 25 m/s, for 10 s."""

    class Parameters(msgspec.Struct, frozen=True):
        pass

    def __init__(self, dt_s: float, aside_m: float) -> None:
        self.mission = Mission(
            dt_s=dt_s,
            lanes=2,
            lane_width_m=3.5,
            speed_limit_mps=25.0,
            desired_speed_mps=25.0,
            goal_x_m=250.0,
        )
        self.steps = round(10.0 / dt_s)
        self.ego = VehicleState(0.0, 0.0, 0.0, 25.0, 5.0, 2.0)
        self.actors = (VehicleState(160.0, aside_m, pi, 25.0, 5.0, 2.0),)

    def __call__(self, parameters: Parameters, seed: int) -> "Oncoming":
        return self

    def move_actor(self, actor: int, step: int, ego: VehicleState) -> VehicleState:
        car = self.actors[actor]
        way_m = car.speed_mps * step * self.mission.dt_s
        return msgspec.structs.replace(car, x_m=car.x_m - way_m)


def drive(
    dt_s: float, aside_m: float, simulator: str, planner: str | None = None
) -> tuple[Observation, Measures]:
    """Last observation and measures of a run without noise; default: at constant speed."""
    driver = Cruise()
    if planner is not None:
        made = plugins.load(plugins.PLANNERS, planner)
        driver = made(read_settings(made.Settings, {}, "planner_settings"))
    opened = plugins.load(plugins.SIMULATORS, simulator)()
    scenario = Oncoming(dt_s, aside_m)
    simulation = opened.open(scenario, scenario.Parameters(), driver, POSITION)
    recorder, now = Recorder(), simulation.reset(1)
    recorder.observe(now, dt_s)
    while not now.ended:
        now = simulation.step((0.0, 0.0))
        recorder.add_disturbance((0.0, 0.0), (1.0, 1.0))
        assert recorder.observe(now, dt_s) == now
    return now, recorder.measures(dt_s)


@pytest.mark.parametrize("simulator", SIMULATORS)
@pytest.mark.parametrize("planner", ["idm", "rulebook", None])
@pytest.mark.parametrize("dt_s", [0.1, 0.2, 0.25, 0.4, 0.5, 1.0])
def test_wrong_way_car_is_struck_at_any_step(simulator, planner, dt_s) -> None:
    last, measures = drive(dt_s, 0.0, simulator, planner)
    assert last.collided
    assert measures.robustness_m == 0.0
    # 160 m less the halves of two footprints at 50 m/s: about 3 s, later if a planner brakes
    assert 2.9 <= measures.collided_s <= 3.6 + dt_s
    assert measures.severity is not None
    assert measures.severity > 25.0**2
    assert measures.min_ttc_s is not None
    assert measures.min_ttc_s <= 0.11


@pytest.mark.parametrize("simulator", SIMULATORS)
@pytest.mark.parametrize("dt_s", [0.2, 0.5, 1.0])
def test_near_pass_between_samples_is_measured(simulator, dt_s) -> None:
    """The smallest distance is the room beside the car, whatever the samples show."""
    fine, coarse = (drive(each, 3.0, simulator) for each in (0.05, dt_s))
    assert not coarse[0].collided
    assert coarse[1].robustness_m == pytest.approx(fine[1].robustness_m, abs=0.002)
    assert coarse[1].robustness_m < 1.1
