"""The example recording, as docs/recorded_traffic.md tells people to use it."""

import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from eigenfail.testing.scenario import SCENARIO_CHECKS
from eigenfail.testing.simulation import SIMULATION_CHECKS
from eigenfail.values.disturbance import POSITION
from eigenfail_exchange.recorded_traffic.scenario import find_log_validity
from eigenfail_workers.simulators.highway import HighwaySimulator

PLUGIN = Path(__file__).parents[1]


@pytest.fixture
def mine(monkeypatch):
    """The module, imported as somebody does who works beside it."""
    monkeypatch.syspath_prepend(PLUGIN / "examples")
    monkeypatch.delitem(sys.modules, "my_recording", raising=False)
    return import_module("my_recording")


@pytest.mark.parametrize("check", SCENARIO_CHECKS)
def test_it_fulfils_the_contract(mine, check):
    check(mine.MyRecording())


@pytest.mark.parametrize("check", SIMULATION_CHECKS)
def test_it_makes_a_simulation_that_keeps_its_own(mine, check):
    scenario, parameters = mine.MyRecording(), mine.MyRecording.Parameters()
    check(lambda planner: HighwaySimulator().open(scenario, parameters, planner, POSITION))


def test_a_vehicle_that_comes_later_is_a_part_of_it(mine):
    tracks = mine.MyRecording.tracks
    assert tracks.ids == ("truck", "lead", "behind", "left", "late")
    assert (tracks.left_out, tracks.notes) == ({}, ())


def test_a_planner_drives_the_truck_and_leaves_the_recording(mine):
    course = mine.drive("rulebook")
    assert len(course) == len(mine.MyRecording.tracks.states)
    valid_s = [find_log_validity(mine.MyRecording.tracks, course, m) for m in mine.DISTANCES_M]
    assert valid_s == sorted(valid_s)
    assert 0.0 < valid_s[0] < 10.0
    assert np.array_equal(course, mine.drive("rulebook"))
