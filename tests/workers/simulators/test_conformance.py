"""The built-in simulators keep the contract, in a calm scenario and in one that ends in a crash."""

from collections.abc import Callable
from typing import Any

import pytest

from eigenfail import plugins
from eigenfail.contracts import Planner, Simulation
from eigenfail.testing.scenario import SCENARIO_CHECKS
from eigenfail.testing.simulation import SIMULATION_CHECKS, OpenSimulation
from eigenfail.values.disturbance import POSITION

BUILT_IN = ("highway", "point_mass")


@pytest.mark.parametrize("gap_m", [30.0, 90.0])
@pytest.mark.parametrize("name", BUILT_IN)
@pytest.mark.parametrize("check", SIMULATION_CHECKS, ids=lambda check: check.__name__)
def test_simulator(
    check: Callable[[OpenSimulation], None], name: str, gap_m: float, small_cut_in: Any
) -> None:
    def open_simulation(planner: Planner) -> Simulation:
        simulator = plugins.load(plugins.SIMULATORS, name)()
        parameters = small_cut_in.Parameters(gap_m, sway_m=3.0)
        return simulator.open(small_cut_in, parameters, planner, POSITION)

    check(open_simulation)


@pytest.mark.parametrize("check", SCENARIO_CHECKS, ids=lambda check: check.__name__)
def test_the_tests_own_scenario(check: Callable[[Any], None], small_cut_in: Any) -> None:
    check(small_cut_in)
