"""Environments of highway-env behind the simulator."""

import warnings
from contextlib import closing

import gymnasium
import numpy as np
import pytest
from msgspec.structs import replace

from eigenfail.errors import PlannerError
from eigenfail.testing.simulation import SIMULATION_CHECKS
from eigenfail.values.channels import Channel
from eigenfail.values.disturbance import POSITION
from eigenfail_gymnasium.environments import GymnasiumParameters
from eigenfail_gymnasium.policies import NO_CONTROL, PolicyPlanner, PolicySettings
from eigenfail_gymnasium.rules import read_vehicles
from eigenfail_gymnasium.scenario import GymnasiumScenario
from eigenfail_gymnasium.simulator import GymnasiumSimulator
from eigenfail_workers.measures.recorder import Recorder

QUICK = {"simulation_frequency": 5}
MERGE = GymnasiumParameters(env="merge-v0", steps=4, config=QUICK)
STOCK = [
    MERGE,
    GymnasiumParameters(env="highway-v0", steps=2, config={**QUICK, "vehicles_count": 5}),
    GymnasiumParameters(env="roundabout-v0", steps=2),
    GymnasiumParameters(env="intersection-v0", steps=2, config=QUICK),
    GymnasiumParameters(env="racetrack-v0", steps=4),
]


class Watcher:
    """Answers one action, and keeps what it was shown."""

    Settings = PolicySettings

    def __init__(self, action):
        self.action = action
        self.seen = []

    def reset(self, mission):
        self.seen.clear()

    def act(self, perception):
        self.seen.append(perception)
        perception.decision.action = self.action
        return NO_CONTROL


def open_with(planner, parameters=MERGE, channels=POSITION, **options):
    return GymnasiumSimulator().open(GymnasiumScenario(), parameters, planner, channels, **options)


def drive(planner, parameters=MERGE, channels=POSITION, errors=(0.0, 0.0), seed=3):
    """The observations of an episode with the same errors at every step."""
    with closing(open_with(planner, parameters, channels)) as simulation:
        seen = [simulation.reset(seed)]
        while not seen[-1].ended:
            seen.append(simulation.step(errors))
    return seen


@pytest.mark.parametrize("check", SIMULATION_CHECKS)
def test_the_simulator_keeps_its_contract(check):
    check(open_with)


@pytest.mark.parametrize("parameters", STOCK, ids=lambda each: each.env)
def test_stock_environments_are_staged_and_repeat_themselves(parameters):
    action = np.zeros(1, np.float32) if parameters.env == "racetrack-v0" else 1
    first = drive(Watcher(action), parameters, errors=(3.0, 0.5))
    assert drive(Watcher(action), parameters, errors=(3.0, 0.5)) == first
    assert len(first) > 1
    assert first[0] == drive(Watcher(action), parameters)[0]


def test_without_errors_the_policy_sees_what_the_environment_shows():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        env = gymnasium.make("merge-v0", config=QUICK)
    shown = [env.reset(seed=3)[0]]
    shown += [env.step(1)[0] for _ in range(3)]
    watcher = Watcher(1)
    drive(watcher)
    assert [perception.observation.tolist() for perception in watcher.seen] == [
        each.tolist() for each in shown
    ]


ALL = ("longitudinal", "lateral", "speed")


@pytest.mark.parametrize("normalize", [True, False])
def test_errors_reach_the_policy_in_metres(normalize):
    config = {**QUICK, "observation": {"type": "Kinematics", "normalize": normalize}}
    config["observation"]["see_behind"] = True
    parameters = replace(MERGE, steps=1, config=config)
    channels = tuple(Channel(name).filled() for name in ALL)

    def read(errors):
        watcher = Watcher(1)
        drive(watcher, parameters, channels, errors)
        (perception,) = watcher.seen
        return read_vehicles(perception.task, perception.observation)

    true, wrong = read((0.0, 0.0, 0.0)), read((4.0, -1.0, 2.5))
    for feature, error in {"x": 4.0, "y": -1.0, "vx": 2.5}.items():
        change = wrong[feature] - true[feature]
        # In float32, of up to 200 m; only the nearest vehicle is disturbed.
        assert max(np.round(change, 3).tolist(), key=abs) == pytest.approx(error, abs=1e-3)
        assert np.count_nonzero(np.abs(change) > 1e-3) == 1


def test_a_missed_vehicle_is_not_observed_and_a_ghost_is():
    names = ("missed", "ghost")
    channels = tuple(Channel(name).filled() for name in names)
    parameters = replace(MERGE, steps=1)
    counts = []
    for errors in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)):
        watcher = Watcher(1)
        drive(watcher, parameters, channels, errors)
        counts.append(int(watcher.seen[0].observation[1:, 0].sum()))
    none, missed, ghost = counts
    assert (missed - none, ghost - none) in {(-1, 1), (0, 0), (-1, 0), (0, 1)}
    assert ghost >= none
    assert missed <= none


def test_a_number_of_the_observation_may_be_wrong():
    channel = Channel("observation.6").filled()
    watcher = Watcher(1)
    drive(watcher, replace(MERGE, steps=1), (channel,), (0.25,))
    still = Watcher(1)
    drive(still, replace(MERGE, steps=1), (channel,), (0.0,))
    change = watcher.seen[0].observation - still.seen[0].observation
    assert change.reshape(-1)[6] == pytest.approx(0.25, abs=1e-6)
    assert np.count_nonzero(change) == 1


def test_collisions_are_those_of_the_environment():
    """Faster and faster, until the rear of another vehicle."""
    config = {**QUICK, "vehicles_count": 8, "lanes_count": 1}
    parameters = GymnasiumParameters(env="highway-v0", steps=8, config=config)
    crashes = []
    with closing(open_with(Watcher(3), parameters)) as simulation:
        for seed in range(6):
            recorder = Recorder()
            recorder.observe(simulation.reset(seed), simulation.dt_s)
            while True:
                shown = simulation.step((0.0, 0.0))
                recorded = recorder.observe(shown, simulation.dt_s)
                flag = bool(simulation._stage._world.vehicle.crashed)
                assert recorded.collided == shown.collided == flag
                if shown.ended:
                    break
            crashes.append(flag)
            assert (recorder.measures(simulation.dt_s).robustness_m == 0.0) == flag
    assert set(crashes) == {True, False} or all(crashes)
    assert any(crashes)


def test_an_answer_that_is_no_action_is_the_planners_fault():
    with closing(open_with(Watcher(99))) as simulation:
        simulation.reset(0)
        with pytest.raises(PlannerError, match="99, which is not in Discrete"):
            simulation.step((0.0, 0.0))


def test_an_end_without_a_failure_is_shown_until_the_horizon():
    parameters = replace(MERGE, steps=18)
    seen = drive(PolicyPlanner(PolicySettings()), parameters, seed=2)
    assert seen[-1].step == 18 or seen[-1].collided
    assert all(one.ego.x_m <= 370.0 + 31.0 for one in seen)
