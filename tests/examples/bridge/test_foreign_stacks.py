"""Stacks of other authors: as they are without noise, and held against the protocol."""

from pathlib import Path

import numpy as np
import pytest

from eigenfail.cli.specs import read_spec
from eigenfail.values.episode import (
    EpisodeTask,
    Outcome,
    PriorSource,
    TrajectorySource,
    episode_seed,
)

BRIDGES = Path(__file__).parents[3] / "examples" / "bridge"
STACKS = {"idm_vehicle": "highway_env", "fiss": "fiss_planner", "dqn": "highway_env"}
"""The package that each bridge needs."""

SIDE_BY_SIDE = 2


@pytest.fixture
def modules(monkeypatch):
    """The modules of the bridges can be imported."""
    monkeypatch.syspath_prepend(BRIDGES)


@pytest.fixture(params=STACKS)
def stack(request, start_python):
    pytest.importorskip(
        STACKS[request.param], reason=f"no {STACKS[request.param]}: pip install '.[examples]'"
    )
    return start_python(f"{request.param}_bridge.py").address, BRIDGES / f"{request.param}.toml"


def test_it_keeps_to_the_protocol_and_repeats_its_episodes(stack, check_bridge, engine) -> None:
    address, file = stack
    check_bridge(address)
    spec = read_spec(file)
    tasks = [EpisodeTask(i, episode_seed(1, i), PriorSource()) for i in range(SIDE_BY_SIDE)]
    results = list(engine(spec, address).run(tasks))
    assert [each.fault for each in results] == [None] * len(tasks)
    again = [EpisodeTask(r.index, r.seed, TrajectorySource(r.noise.z)) for r in results]
    replays = list(engine(spec, address).run(again))
    assert [each.digest() for each in replays] == [each.digest() for each in results]
    assert len({each.digest() for each in results}) == len(tasks)

    calm = EpisodeTask(0, 0, TrajectorySource(np.zeros_like(results[0].noise.z)))
    (undisturbed,) = engine(spec, address).run([calm])
    assert undisturbed.outcome is Outcome.SAFE


@pytest.mark.usefixtures("modules")
def test_undisturbed_the_ego_drives_as_highway_env_drives_it() -> None:
    """Beside a driver of highway-env that the environment asks itself, without a bridge."""
    import gymnasium
    from highway_env.vehicle.behavior import IDMVehicle
    from idm_vehicle_bridge import CONFIG, IDLE, drive
    from perceived_road import state

    asked = {
        "scenario": "highway-fast-v0",
        "planner": "IDMVehicle",
        "parameters": {"traffic": 7},
        "settings": {},
        "steps": 60,
        "channels": [{"name": "longitudinal"}, {"name": "lateral"}],
    }
    world = drive(asked)
    seen = [world.reset(0)]
    while not seen[-1].ended:
        seen.append(world.step((0.0, 0.0)))

    alone = gymnasium.make("highway-fast-v0", config=CONFIG).unwrapped
    alone.reset(seed=7)
    vehicles, before = alone.road.vehicles, alone.vehicle
    ego = IDMVehicle.create_from(before)
    vehicles[vehicles.index(before)] = alone.controlled_vehicles[0] = ego
    course = [state(ego)]
    for _ in seen[1:]:
        alone.step(IDLE)
        course.append(state(ego))
    assert len(seen) == asked["steps"] + 1
    assert [each.ego for each in seen] == course


@pytest.mark.usefixtures("modules")
def test_errors_are_gone_when_the_driver_has_decided() -> None:
    import gymnasium
    import highway_env
    from perceived_road import others, perceive, state

    gymnasium.register_envs(highway_env)
    environment = gymnasium.make("highway-fast-v0").unwrapped
    environment.reset(seed=1)
    before = [state(each) for each in others(environment)]
    errors = {"longitudinal": 2.0, "lateral": -0.5, "speed": 1.0}
    with perceive(environment, errors) as seen:
        during = [state(each) for each in others(environment)]
    (number,) = [i for i, one in enumerate(during) if one != before[i]]
    assert seen == (during[number].x_m, during[number].y_m)
    assert during[number].x_m == pytest.approx(before[number].x_m + 2.0)
    assert during[number].y_m == pytest.approx(before[number].y_m - 0.5)
    assert during[number].speed_mps == pytest.approx(before[number].speed_mps + 1.0)
    with perceive(environment, {"missed": 1.0}) as seen:
        left = len(others(environment))
    assert left == len(before) - 1
    assert np.isnan(seen).all()
    assert [state(each) for each in others(environment)] == before


@pytest.mark.usefixtures("modules")
def test_the_arrays_of_the_agent_value_actions_as_stable_baselines3_does() -> None:
    pytest.importorskip("highway_env", reason="no highway_env: pip install '.[worker]'")
    pytest.importorskip("stable_baselines3", reason="no stable_baselines3: pip install '.[server]'")
    import torch
    from dqn_bridge import Agent
    from dqn_training import SEED, build, make, read_arrays

    model = build(make(SEED))
    agent = Agent(read_arrays(model))
    random = np.random.default_rng(1)
    observations = random.uniform(-1.0, 1.0, (20, 5, 5)).astype(np.float32)
    with torch.no_grad():
        values = model.q_net(torch.as_tensor(observations)).numpy()
    ours = np.array([agent.value_actions(each) for each in observations])
    np.testing.assert_allclose(ours, values, atol=1e-5)
    assert len(set(values.argmax(1))) > 1


@pytest.mark.usefixtures("modules")
def test_a_policy_that_is_not_the_one_of_the_page_is_refused(monkeypatch, tmp_path) -> None:
    pytest.importorskip("highway_env", reason="no highway_env: pip install '.[worker]'")
    import dqn_bridge

    from eigenfail.errors import SimulatorError

    page = (BRIDGES.parents[1] / "docs" / "foreign_stacks.md").read_text()
    assert dqn_bridge.DIGEST in page
    shapes = {name: array.shape for name, array in dqn_bridge.read_policy().items()}
    assert shapes["weight_2"] == (3, 256)
    other = tmp_path / "other.npz"
    np.savez(other, weight_0=np.zeros((5, 25), np.float32), bias_0=np.zeros(5, np.float32))
    monkeypatch.setattr(dqn_bridge, "POLICY", other)
    with pytest.raises(SimulatorError, match=r"other\.npz"):
        dqn_bridge.read_policy()


def test_no_module_of_a_bridge_reads_a_pickle() -> None:
    for file in BRIDGES.glob("*.py"):
        assert "allow_pickle=True" not in file.read_text(), file.name
        assert "import pickle" not in file.read_text(), file.name
