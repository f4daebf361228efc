"""Every planner, scenario and simulator of the core keeps its contract."""

import pytest
from core_worlds import list_core_names

from eigenfail import plugins
from eigenfail.testing.planner import PLANNER_CHECKS
from eigenfail.testing.scenario import SCENARIO_CHECKS
from eigenfail.testing.simulation import SIMULATION_CHECKS
from eigenfail.values.disturbance import POSITION


def named(check) -> str:
    return check.__name__


@pytest.mark.parametrize("name", list_core_names(plugins.PLANNERS))
@pytest.mark.parametrize("check", PLANNER_CHECKS, ids=named)
def test_planners(check, name: str) -> None:
    planner = plugins.load(plugins.PLANNERS, name)
    check(lambda: planner(planner.Settings()))


@pytest.mark.parametrize("name", list_core_names(plugins.SCENARIOS))
@pytest.mark.parametrize("check", SCENARIO_CHECKS, ids=named)
def test_scenarios(check, name: str) -> None:
    check(plugins.load(plugins.SCENARIOS, name)())


@pytest.mark.parametrize("scenario", list_core_names(plugins.SCENARIOS))
@pytest.mark.parametrize("simulator", list_core_names(plugins.SIMULATORS))
@pytest.mark.parametrize("check", SIMULATION_CHECKS, ids=named)
def test_simulations(check, simulator: str, scenario: str) -> None:
    opener = plugins.load(plugins.SIMULATORS, simulator)()
    staged = plugins.load(plugins.SCENARIOS, scenario)
    check(lambda planner: opener.open(staged(), staged.Parameters(), planner, POSITION))
