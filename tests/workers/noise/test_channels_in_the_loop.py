"""Channels in whole episodes: recorded, replayed bit for bit, and none for the position's sake."""

from collections.abc import Callable
from math import log, pi
from statistics import NormalDist
from typing import Any

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.plugins import SCENARIOS, SIMULATORS
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.channels import ALL_CHANNELS, Channel
from eigenfail.values.disturbance import DisturbanceModel, NoiseTrajectory, ScenarioCorrelation
from eigenfail.values.episode import (
    EpisodeTask,
    Outcome,
    PolicySource,
    PriorSource,
    TrajectorySource,
)
from eigenfail.values.learning import SCENE_STATE, Layer, Policy, count_state
from eigenfail.values.shapes import Autoregressive, HeavyTailed, Markov
from eigenfail.worlds import list_channels, resolve_disturbance

POSITION = (Channel("longitudinal"), Channel("lateral"))
EVENTS = (Channel("missed", shape=Markov(0.1, 5.0)), Channel("ghost", shape=Markov(0.05, 3.0)))
SETS = {
    "missed": EVENTS[:1],
    "every": (Channel("every.longitudinal"), Channel("every.lateral"), Channel("every.missed")),
    "all": (
        *POSITION,
        *EVENTS,
        Channel("heading", shape=Autoregressive(0.9)),
        Channel("vehicle_2.speed", shape=HeavyTailed(4.0)),
        Channel("ego.speed"),
        Channel("length"),
        Channel("delay", 0.3),
        Channel("swapped", shape=Markov(0.1, 3.0)),
    ),
    "delay": (Channel("delay", 0.5),),
    "missed by distance": (
        *POSITION,
        Channel("vehicle_2.missed", shape=Markov(0.01, 3.0, 0.002)),
    ),
}
TASKS = tuple(EpisodeTask(index, 900 + index, PriorSource()) for index in range(6))

MakeEngine = Callable[..., Any]


def run(engine: Any, tasks: tuple[EpisodeTask, ...] = TASKS) -> list[Any]:
    results = list(engine.run(tasks))
    assert [each.fault for each in results if each.outcome is Outcome.ERRORED] == []
    return results


def test_the_channels_of_the_position_by_name_give_the_same_episodes(make_engine) -> None:
    named = run(make_engine(disturbance=DisturbanceModel(channels=POSITION, scale=1.5)))
    plain = run(make_engine(disturbance=DisturbanceModel(scale=1.5)))
    assert [each.digest() for each in named] == [each.digest() for each in plain]


@pytest.mark.parametrize("name", SETS)
def test_a_replay_of_its_z_is_the_episode_bit_for_bit(make_engine: MakeEngine, name: str) -> None:
    model = DisturbanceModel(channels=SETS[name])
    resolved = model.resolve(2, ALL_CHANNELS)
    engine = make_engine(disturbance=model, scene_every=1)
    first = run(engine)
    replays = tuple(
        EpisodeTask(50 + each.index, each.seed, TrajectorySource(each.noise.z)) for each in first
    )
    again = run(engine, replays)
    assert [each.digest() for each in again] == [each.digest() for each in first]
    for each in first:
        count = len(resolved.list_channels())
        assert each.noise.z.shape == each.noise.sigma.shape == (each.steps, count)
        assert np.isfinite(each.noise.log_probability)
    assert len({each.digest() for each in first}) == len(first)


def test_episodes_do_not_depend_on_their_neighbours(make_engine: MakeEngine) -> None:
    model = DisturbanceModel(channels=SETS["all"])
    together = run(make_engine(disturbance=model))
    alone = [run(make_engine(disturbance=model), (task,))[0] for task in reversed(TASKS)]
    assert [each.digest() for each in reversed(alone)] == [each.digest() for each in together]


def test_the_scene_says_where_the_nearest_vehicle_was_not_perceived(make_engine) -> None:
    model = DisturbanceModel(channels=EVENTS[:1])
    for result in run(make_engine(disturbance=model, scene_every=1)):
        missed = result.noise.injected[:, 0] > 0.5
        assert np.isnan(result.scene.perceived[:, 0]).tolist() == missed.tolist()


def test_a_vehicle_is_missed_at_the_rate_of_its_distance(make_engine, steady) -> None:
    chains = Markov(0.01, 3.0, 0.002), Markov(0.02, 3.0, 0.02)
    channels = tuple(Channel(f"vehicle_{n}.missed", shape=one) for n, one in enumerate(chains, 1))
    model = DisturbanceModel(channels=channels, scale=2.0)
    largest = 0.0
    for result in run(make_engine(steady, disturbance=model, scene_every=1)):
        course = result.scene.vehicles[: result.steps]
        apart = np.hypot(*np.moveaxis(course[:, 1:, :2] - course[:, :1, :2], -1, 0))
        rates = np.minimum([0.01, 0.02] + apart * [0.002, 0.02], 0.5)
        assert result.noise.sigma == pytest.approx(rates, rel=1e-4)
        assert set(result.noise.injected.ravel().tolist()) <= {0.0, 1.0}
        largest = max(largest, float(result.noise.sigma.max()))
    assert largest == 0.5


def test_what_others_hide_is_not_detected(make_engine, plug_in, small_cut_in, steady) -> None:
    class File(type(small_cut_in)):
        def __call__(self, parameters: Any, seed: int) -> Any:
            staged = super().__call__(parameters, seed)
            first = staged.actors[0]
            # It stands on the line from the front of the truck to the first one, which drives on.
            second = replace(first, x_m=first.x_m + 20.0, y_m=5.65, speed_mps=0.0)
            return replace(staged, actors=(first, second))

    class Watching(steady):
        def reset(self, mission: Any) -> None:
            super().reset(mission)
            seen.clear()

        def act(self, perception: Any) -> Any:
            seen.append(perception.ids)
            return super().act(perception)

    seen: list[tuple[int, ...]] = []
    plug_in(SCENARIOS, "file", File)
    hiding = DisturbanceModel(occlusion=True)
    (hid,) = run(make_engine(Watching, disturbance=hiding, scenario="file"), TASKS[:1])
    assert seen[0] == (1,)
    assert set(seen) == {(1,), (1, 2)}
    (free,) = run(make_engine(Watching, scenario="file"), TASKS[:1])
    assert set(seen) == {(1, 2)}
    assert hid.noise.z.tobytes() == free.noise.z.tobytes()


def test_only_simulators_that_offer_it_hide_vehicles(make_engine, plug_in) -> None:
    class Open:
        channels = ALL_CHANNELS

    hiding = DisturbanceModel(occlusion=True)
    fields = {"name": "x", "method": "held", "episodes": 5}
    plug_in(SIMULATORS, "open", Open)
    for simulator in ("bridge", "function", "open"):
        spec = CampaignSpec(**fields, simulator=simulator, disturbance=hiding)
        with pytest.raises(InvalidValue, match="does not know what vehicles hide") as refused:
            resolve_disturbance(spec)
        assert refused.value.field == "disturbance.occlusion"
    off = CampaignSpec(**fields, disturbance=DisturbanceModel(occlusion=False))
    assert resolve_disturbance(off) == DisturbanceModel()
    assert b"occlusion" not in msgspec.json.encode(resolve_disturbance(off))


def test_a_function_has_no_channels_to_name_here() -> None:
    fields = {"name": "x", "method": "held", "episodes": 5}
    model = DisturbanceModel(channels=(Channel("speed"),))
    function = CampaignSpec(**fields, simulator="function", disturbance=model)
    with pytest.raises(InvalidValue, match="scenario_parameters"):
        resolve_disturbance(function)
    road = CampaignSpec(**fields, disturbance=DisturbanceModel(channels=(Channel("every.speed"),)))
    resolved = resolve_disturbance(road)
    assert [each.name for each in resolved.list_channels()] == ["vehicle_1.speed"]
    assert list_channels(CampaignSpec(**fields, disturbance=resolved)) == ("vehicle_1.speed",)


VARIED = {"gap_m": {"uniform": [25.0, 35.0]}, "sway_m": {"uniform": [0.0, 1.0]}}
SEARCHED = (*POSITION, Channel("scenario.gap_m"))


def searched(make_engine: MakeEngine, **parameters: Any) -> Any:
    model = DisturbanceModel(channels=SEARCHED)
    return make_engine(
        disturbance=model, scene_every=1, scenario_parameters={**VARIED, **parameters}
    )


def gaps(results: list[Any]) -> list[float]:
    return [float(each.scene.vehicles[0, 1, 0]) - 10.5 for each in results]


def test_a_searched_parameter_is_the_quantile_of_its_first_z(make_engine) -> None:
    results = run(searched(make_engine, sway_m=0.0))
    expected = [25.0 + 10.0 * NormalDist().cdf(float(each.noise.z[0, 2])) for each in results]
    assert gaps(results) == pytest.approx(expected, abs=1e-4)
    assert len(set(gaps(results))) == len(results)


def test_searched_parameters_are_correlated_before_their_quantiles(make_engine) -> None:
    channels = (Channel("scenario.gap_m"), *POSITION, Channel("scenario.slower_mps"))
    pair = ScenarioCorrelation(("scenario.slower_mps", "scenario.gap_m"), -0.6)
    sample = [4.0, 8.0, 6.0]
    engine = make_engine(
        disturbance=DisturbanceModel(channels=channels, correlations=(pair,)),
        scene_every=1,
        scenario_parameters={"gap_m": VARIED["gap_m"], "slower_mps": {"empirical": sample}},
    )
    results = run(engine)
    for each in results:
        first, second = each.noise.z[0, [0, 3]].tolist()
        share = NormalDist().cdf(-0.6 * first + 0.8 * second)
        slower = 20.0 - float(each.scene.vehicles[0, 1, 3])
        assert slower == pytest.approx(np.quantile(sample, share), abs=1e-4)
    expected = [25.0 + 10.0 * NormalDist().cdf(float(each.noise.z[0, 0])) for each in results]
    assert gaps(results) == pytest.approx(expected, abs=1e-4)
    z = results[0].noise.counted_z
    assert results[0].noise.log_probability == pytest.approx(
        NoiseTrajectory(z[:, 1:3], results[0].noise.sigma[:, 1:3]).log_probability
        - 0.5 * float(z[0, 0] ** 2 + z[0, 3] ** 2)
        - log(2.0 * pi),
        rel=1e-6,
    )


def test_correlations_need_channels_of_the_scenario() -> None:
    pair = ScenarioCorrelation(("scenario.distance_m", "scenario.ego_speed_mps"), 0.5)
    for simulator in ("highway", "bridge", "function"):
        spec = CampaignSpec(
            name="x",
            method="held",
            episodes=5,
            simulator=simulator,
            disturbance=DisturbanceModel(correlations=(pair,)),
        )
        with pytest.raises(UnknownName) as refused:
            resolve_disturbance(spec)
        assert refused.value.field == "disturbance.correlations[0].channels"


def test_later_z_of_a_searched_parameter_are_without_effect(make_engine) -> None:
    engine = searched(make_engine)
    (first,) = run(engine, TASKS[:1])
    z = first.noise.z.copy()
    z[1:, 2] = 3.0
    (again,) = run(engine, (EpisodeTask(7, first.seed, TrajectorySource(z)),))
    assert again.scene.vehicles.tobytes() == first.scene.vehicles.tobytes()
    assert again.noise.log_probability == first.noise.log_probability


def test_under_a_policy_a_parameter_is_drawn_and_observed(make_engine) -> None:
    states = count_state(3)
    layer = Layer(np.zeros((3, states), np.float32), np.zeros(3, np.float32))
    engine = searched(make_engine)
    engine.add_policy(Policy(1, (), layer, layer, 2.0, 10))
    tasks = tuple(EpisodeTask(each.index, each.seed, PolicySource(1)) for each in TASKS)
    results = run(engine, tasks)
    for each in results:
        w = float(each.noise.z[0, 2])
        assert set(each.noise.z[:, 2].tolist()) == {w}
        assert each.states[:, SCENE_STATE + 2] == pytest.approx(w / 3.0)
    assert len({float(each.noise.z[0, 2]) for each in results}) == len(results)
