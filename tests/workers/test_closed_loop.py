"""A planner in the loop: what it is shown, and what its answers may be."""

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
import pytest

from eigenfail.errors import InvalidValue, PlannerError, SimulatorError
from eigenfail.values.disturbance import POSITION
from eigenfail.values.scene import Control, Mission, Perception, VehicleState
from eigenfail_workers.closed_loop import DrivenSimulation, validate_control
from eigenfail_workers.perception import SensorErrors
from eigenfail_workers.values import GroundTruth


def car(x: float, y: float = 0.0) -> VehicleState:
    return VehicleState(x, y, 0.0, 10.0, 5.0, 2.0)


class Film:
    """A world that shows prepared truths."""

    def __init__(self, truths: Sequence[GroundTruth]) -> None:
        self.truths = truths

    def reset(self, situation: Any) -> GroundTruth:
        self.next = 1
        self.driven: list[Control] = []
        return self.truths[0]

    def advance(self, control: Control) -> GroundTruth:
        self.next += 1
        self.driven.append(control)
        return self.truths[self.next - 1]


class Watcher:
    def __init__(self) -> None:
        self.seen: list[Perception] = []

    def reset(self, mission: Mission) -> None:
        self.mission = mission

    def act(self, perception: Perception) -> Control:
        self.seen.append(perception)
        return Control(1.0, 0.0)


def loop(scenario: Any, planner: Any, *truths: GroundTruth) -> DrivenSimulation:
    return DrivenSimulation(
        Film(truths), scenario, scenario.Parameters(), planner, SensorErrors(POSITION)
    )


FREE = GroundTruth(car(0.0), (car(30.0, 3.5), car(-40.0)), False)
CROSSED = GroundTruth(car(0.0), (car(50.0, 3.5), car(-20.0)), False)
CRASHED = GroundTruth(car(0.0), (car(50.0, 3.5), car(-5.0)), True)


def test_noise_moves_over_when_another_vehicle_becomes_the_nearest(small_cut_in: Any) -> None:
    planner = Watcher()
    simulation = loop(small_cut_in, planner, FREE, CROSSED, CRASHED)
    simulation.reset(0)
    first, second = simulation.step((1.0, -0.5)), simulation.step((2.0, 0.25))
    assert planner.seen[0].others == (car(31.0, 3.0), car(-40.0))
    assert planner.seen[1].others == (car(50.0, 3.5), car(-18.0, 0.25))
    assert (first.perceived, second.perceived) == ((31.0, 3.0), (-18.0, 0.25))
    assert [seen.time_s for seen in planner.seen] == [0.0, 0.1]
    assert (first.ended, second.ended, second.collided) == (False, True, True)


def test_the_planner_is_told_the_mission_and_nothing_else(small_cut_in: Any) -> None:
    planner = Watcher()
    loop(small_cut_in, planner, FREE).reset(3)
    assert planner.mission == small_cut_in(small_cut_in.Parameters(), 3).mission
    assert vars(planner).keys() == {"seen", "mission"}


def test_the_planner_cannot_write_into_what_it_is_shown(small_cut_in: Any) -> None:
    planner = Watcher()
    simulation = loop(small_cut_in, planner, FREE, CROSSED)
    simulation.reset(0)
    simulation.step((1.0, 0.0))
    (perception,) = planner.seen
    for value, field in (
        (perception, "ego"),
        (perception.ego, "x_m"),
        (perception.others[0], "x_m"),
    ):
        with pytest.raises(AttributeError):
            setattr(value, field, 0.0)


def test_a_start_in_a_collision_is_the_inputs_fault(small_cut_in: Any) -> None:
    with pytest.raises(InvalidValue, match="starts in a collision"):
        loop(small_cut_in, Watcher(), CRASHED).reset(0)


def test_a_planner_that_cannot_be_reset_is_blamed(small_cut_in: Any) -> None:
    planner = Watcher()
    planner.reset = lambda mission: 1 / 0
    with pytest.raises(PlannerError, match=r"reset raised ZeroDivisionError: division by zero\."):
        loop(small_cut_in, planner, FREE).reset(0)


def test_a_closed_simulation_cannot_go_on(small_cut_in: Any) -> None:
    simulation = loop(small_cut_in, Watcher(), FREE, CROSSED)
    simulation.reset(0)
    simulation.close()
    with pytest.raises(SimulatorError, match="Reset"):
        simulation.step((0.0, 0.0))
    with pytest.raises(SimulatorError, match="closed"):
        simulation.reset(0)


@pytest.mark.parametrize(
    "answer",
    [None, 1.0, (0.0, 0.0), {"acceleration_mps2": 0.0}, Control(float("nan"), 0.0)],
)
def test_what_is_no_control_is_refused(answer: object) -> None:
    with pytest.raises(PlannerError, match="two finite numbers"):
        validate_control(answer)


def test_numpys_numbers_become_plain_ones() -> None:
    control = validate_control(Control(np.float64(1.0), np.float32(0.5)))
    assert [type(value) for value in msgspec.structs.astuple(control)] == [float, float]


def test_what_was_asked_for_and_what_was_applied_are_told(small_cut_in: Any) -> None:
    planner, world = Watcher(), Film((FREE, FREE, FREE, FREE))
    simulation = DrivenSimulation(
        world, small_cut_in, small_cut_in.Parameters(), planner, SensorErrors(POSITION)
    )
    start = simulation.reset(0)
    assert (start.control, start.applied) == (None, None)
    for asked, applied in (
        (Control(-3.0, 0.1), Control(-3.0, 0.1)),
        (Control(-50.0, -3.0), Control(-7.0, -np.pi / 4)),
        # at 10 m/s 400 kW move 30 t by 4/3 m/s²
        (Control(50.0, 3.0), Control(4.0 / 3.0, np.pi / 4)),
    ):
        planner.act = lambda perception, asked=asked: asked
        seen = simulation.step((0.0, 0.0))
        assert seen.control == asked
        assert seen.applied == world.driven[-1]
        assert msgspec.structs.astuple(seen.applied) == pytest.approx(
            msgspec.structs.astuple(applied)
        )
