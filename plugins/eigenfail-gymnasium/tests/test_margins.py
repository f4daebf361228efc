"""Environments that are no roads, and the known region of failures of one."""

from contextlib import closing

import pytest
from approach_environment import ID, MODULE

from eigenfail.errors import InvalidValue, PlannerError
from eigenfail.testing.simulation import Cruise
from eigenfail.values.channels import Channel
from eigenfail.values.disturbance import POSITION
from eigenfail_gymnasium.environments import GymnasiumParameters
from eigenfail_gymnasium.policies import PolicyPlanner, PolicySettings
from eigenfail_gymnasium.scenario import GymnasiumScenario
from eigenfail_gymnasium.simulator import GymnasiumSimulator
from eigenfail_workers.measures.recorder import Recorder

MARGIN = {"env": ID, "margin": f"{MODULE}:distance"}
KEY = {"env": ID, "failure_key": "hit"}
DISTANCE = (Channel("observation.0").filled(),)


def open_with(planner, parameters, channels=DISTANCE):
    given = GymnasiumParameters(**parameters)
    return GymnasiumSimulator().open(GymnasiumScenario(), given, planner, channels)


def record(parameters, error, function="brake"):
    """The record of an episode with a constant error of the perceived distance. [m]"""
    planner = PolicyPlanner(PolicySettings(function=f"{MODULE}:{function}"))
    recorder = Recorder()
    with closing(open_with(planner, parameters)) as simulation:
        shown = recorder.observe(simulation.reset(0), simulation.dt_s)
        while not shown.ended:
            shown = recorder.observe(simulation.step((error,)), simulation.dt_s)
            recorder.add_disturbance((error,), (1.0,))
    return recorder


@pytest.mark.parametrize("parameters", [MARGIN, KEY, {"env": ID}])
@pytest.mark.parametrize(
    ("error", "fails"), [(-5.0, False), (0.0, False), (0.99, False), (1.01, True), (8.0, True)]
)
def test_braking_by_the_perceived_distance_fails_if_it_is_overestimated_by_a_metre(
    parameters, error, fails
):
    assert record(parameters, error).collided == fails


@pytest.mark.parametrize(("error", "left_m"), [(0.0, 2.0), (-1.5, 4.0), (-5.0, 6.0), (2.0, 0.0)])
def test_the_robustness_is_the_smallest_margin(error, left_m):
    assert record(MARGIN, error).measures(1.0).robustness_m == pytest.approx(left_m)


def test_a_policy_that_remembers_begins_anew_in_each_episode():
    planner = PolicyPlanner(PolicySettings(function=f"{MODULE}:counts"))
    with closing(open_with(planner, MARGIN)) as simulation:
        ways = []
        for _ in range(2):
            simulation.reset(0)
            ways.append([simulation.step((0.0,)).others[0].x_m for _ in range(5)])
    assert ways[0] == ways[1]


def test_the_horizon_is_that_of_the_id():
    for given, steps in (({}, 8), ({"steps": 3}, 3)):
        assert GymnasiumScenario()(GymnasiumParameters(**MARGIN, **given), 0).steps == steps


def test_a_key_that_info_lacks_is_refused_with_those_that_it_has():
    with pytest.raises(InvalidValue, match=r"no 'crashed' .* It has: calm, hit"):
        record({"env": ID, "failure_key": "crashed"}, 5.0)


def test_errors_of_vehicles_and_controls_mean_nothing_where_there_is_no_road():
    with pytest.raises(InvalidValue, match=r"no vehicles .* observation\.0"):
        open_with(Cruise(), KEY, POSITION)
    with closing(open_with(Cruise(), KEY)) as simulation:
        simulation.reset(0)
        with pytest.raises(PlannerError, match='planner = "policy"'):
            simulation.step((0.0,))


@pytest.mark.parametrize("function", ["wrong", "raises"])
def test_a_policys_faults_are_the_planners(function):
    with pytest.raises(PlannerError):
        record(MARGIN, 0.0, function)
