"""Channels on a bridge: the same episodes as built in, and names that the bridge does not offer."""

import numpy as np
import pytest

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.channels import ALL_CHANNELS, Channel
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.episode import (
    EpisodeSetup,
    EpisodeTask,
    PriorSource,
    TrajectorySource,
    episode_seed,
)
from eigenfail.values.shapes import Markov
from eigenfail.worlds import resolve_disturbance
from eigenfail_workers.engine import Engine

POSITION = (Channel("longitudinal", 2.0), Channel("lateral"))
SEARCHED = {"steps": 100, "distance_m": {"uniform": [56.0, 60.0]}}
SETS = {
    "misses": (*POSITION, Channel("missed", shape=Markov(0.1, 5.0))),
    "ghosts": (*POSITION, Channel("ghost", shape=Markov(0.02, 5.0), ahead_m=30.0)),
    "delay": (*POSITION, Channel("delay", 0.4)),
    "of a vehicle": (Channel("vehicle_1.speed", 2.0), Channel("vehicle_1.length")),
    "of the ego": (Channel("ego.speed"), Channel("ego.heading"), Channel("ego.lateral")),
    "joint": (*POSITION, Channel("scenario.distance_m")),
}
TASKS = [EpisodeTask(i, episode_seed(5, i), PriorSource()) for i in range(6)]


def make_built_in(model: DisturbanceModel, planner: str, parameters: dict[str, object]) -> Engine:
    inside = {name: value for name, value in parameters.items() if name != "steps"}
    return Engine(EpisodeSetup("highway", "cut_in", inside, planner, {}, model))


@pytest.mark.parametrize("planner", ["idm", "rulebook"])
@pytest.mark.parametrize("name", SETS)
def test_episodes_are_those_of_the_same_world_built_in(name, planner, serving, on_bridge) -> None:
    model = DisturbanceModel(channels=SETS[name])
    parameters = SEARCHED if name == "joint" else {"steps": 100}
    expected = list(make_built_in(model, planner, parameters).run(TASKS))
    with serving() as address:
        engine = on_bridge(address, planner, disturbance=model, scenario_parameters=parameters)
        found = list(engine.run(TASKS))
    assert [each.fault for each in found] == [None] * len(TASKS)
    assert [each.digest() for each in found] == [each.digest() for each in expected]
    scenes = [(one.scene, other.scene) for one, other in zip(found, expected, strict=True)]
    kept = [pair for pair in scenes if None not in pair]
    assert kept
    for one, other in kept:
        for array in ("vehicles", "controls", "perceived"):
            np.testing.assert_array_equal(getattr(one, array), getattr(other, array))


def test_a_bridge_that_leaves_out_what_was_perceived_gives_the_same_scenes(
    serving, on_bridge, minimal, monkeypatch
) -> None:
    model = DisturbanceModel(
        channels=(*POSITION, Channel("missed", shape=Markov(0.2, 3.0)), Channel("delay", 0.4))
    )
    with serving() as address:
        (told,) = on_bridge(address, disturbance=model, scene_every=1).run(TASKS[:1])
    shown = minimal.shown
    monkeypatch.setattr(minimal, "shown", lambda seen: shown(seen) | {"perceived": None})
    with serving() as address:
        (derived,) = on_bridge(address, disturbance=model, scene_every=1).run(TASKS[:1])
    assert np.isnan(told.scene.perceived).any()
    np.testing.assert_array_equal(derived.scene.perceived, told.scene.perceived)


@pytest.mark.parametrize("channels", [["lateral"], None])
def test_a_campaign_that_names_a_channel_of_a_position_runs_where_it_is_offered(
    channels, serving, on_bridge
) -> None:
    lateral = DisturbanceModel(channels=(Channel("lateral", 2.0),))
    expected = make_built_in(lateral, "idm", {}).run(TASKS[:3])
    with serving(channels=channels) as address:
        found = list(on_bridge(address, disturbance=lateral).run(TASKS[:3]))
    assert [each.digest() for each in found] == [each.digest() for each in expected]


def test_a_replay_of_its_z_is_the_episode_bit_for_bit(serving, on_bridge) -> None:
    model = DisturbanceModel(channels=SETS["ghosts"])
    with serving() as address:
        (first,) = on_bridge(address, disturbance=model).run(TASKS[:1])
        again = EpisodeTask(0, first.seed, TrajectorySource(first.noise.z))
        (replayed,) = on_bridge(address, disturbance=model).run([again])
    assert replayed.digest() == first.digest()


@pytest.mark.parametrize(
    ("name", "changes", "said"),
    [
        ("missed", {"channels": None}, "'minimal' (version 1). Known: lateral, longitudinal."),
        ("missed", {"channels": ["mised"]}, "Did you mean 'mised'?"),
        ("vehicle_1.speed", {"channels": ["vehicle_2.speed"]}, "Did you mean 'vehicle_2.speed'?"),
        ("vehicle_7.speed", {}, "'vehicle_7.speed' is of vehicle 7, and there are 1."),
    ],
)
def test_a_channel_that_the_bridge_does_not_offer_is_the_campaigns_fault(
    name, changes, said, serving, on_bridge
) -> None:
    model = DisturbanceModel(channels=(Channel(name),))
    with serving(**changes) as address:
        engine = on_bridge(address, disturbance=model)
        (result,) = engine.run(TASKS[:1])
    assert result.fault.kind == "input"
    assert said in result.fault.message
    assert bool(engine.declined) == ("is not known" in result.fault.message)


def test_only_names_of_channels_are_launched() -> None:
    def resolve(name: str) -> DisturbanceModel:
        model = DisturbanceModel(channels=(Channel(name),))
        fields = {"name": "x", "method": "held", "episodes": 5, "disturbance": model}
        parameters = {"steps": 9, "gap_m": {"uniform": [1.0, 2.0]}}
        return resolve_disturbance(
            CampaignSpec(**fields, simulator="bridge", scenario_parameters=parameters)
        )

    for name in ("vehicle_3.speed", "scenario.gap_m", *ALL_CHANNELS):
        if not name.startswith("every."):
            assert [each.name for each in resolve(name).list_channels()] == [name]
    with pytest.raises(UnknownName, match="Did you mean 'missed'"):
        resolve("mised")
    with pytest.raises(UnknownName, match=r"scenario\.gap_m"):
        resolve("scenario.gap")
    with pytest.raises(InvalidValue, match=r"one by one, such as vehicle_1\.speed"):
        resolve("every.speed")


def test_seeds_go_as_text_where_the_bridge_asks_for_that(
    serving, on_bridge, minimal, monkeypatch
) -> None:
    seeds = []
    reset = minimal.Bridge.reset

    def listen(bridge, held, asked):
        seeds.append(asked["seed"])
        return reset(bridge, held, asked)

    monkeypatch.setattr(minimal.Bridge, "reset", listen)
    found = []
    for changes in ({"seed_text": True}, {}):
        with serving(**changes) as address:
            found += on_bridge(address).run(TASKS[:1])
    assert seeds == [str(TASKS[0].seed), TASKS[0].seed]
    assert len({each.digest() for each in found}) == 1
