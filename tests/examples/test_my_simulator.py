"""The example simulator. tests/docs/test_pages.py holds it against its contract, with its page."""

import sys
from importlib import import_module
from pathlib import Path

import pytest

from eigenfail.values.disturbance import POSITION
from eigenfail_workers.planners.idm import IntelligentDriver
from eigenfail_workers.scenarios.cut_in import CutIn

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture
def simulator(monkeypatch):
    monkeypatch.setattr(sys, "path", [*sys.path, str(EXAMPLES)])
    return import_module("my_simulator").LaggingBrakes()


def test_its_brakes_take_a_moment(simulator):
    planner = IntelligentDriver(IntelligentDriver.Settings())
    simulation = simulator.open(CutIn(), CutIn.Parameters(), planner, POSITION)
    seen = [simulation.reset(0)]
    while not seen[-1].ended:
        seen.append(simulation.step((0.0, 0.0)))
    told = [each for each in seen[1:] if each.control.acceleration_mps2 < -2.0]
    assert told
    assert told[0].applied.acceleration_mps2 > told[0].control.acceleration_mps2 + 0.5
    assert not seen[-1].collided


def test_its_brakes_are_those_of_the_scenario(simulator):
    planner = IntelligentDriver(IntelligentDriver.Settings())
    weak = CutIn.Parameters(peak_braking_mps2=3.2)
    simulation = simulator.open(CutIn(), weak, planner, POSITION)
    seen = [simulation.reset(0)]
    while not seen[-1].ended:
        seen.append(simulation.step((0.0, 0.0)))
    assert seen[0].peak_braking_mps2 == 3.2
    assert min(each.applied.acceleration_mps2 for each in seen[1:]) == pytest.approx(-3.2, abs=0.2)
    assert all(each.applied.acceleration_mps2 >= -3.2 for each in seen[1:])
