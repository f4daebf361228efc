"""Every shape in whole episodes: what was injected is recorded, and can be injected again."""

from collections.abc import Callable
from math import hypot
from typing import Any

import msgspec
import numpy as np
import pytest

from eigenfail import plugins
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.episode import (
    EpisodeResult,
    EpisodeTask,
    Outcome,
    PriorSource,
    TrajectorySource,
)
from eigenfail.values.scene import VehicleState
from eigenfail.values.shapes import Correlated, HeavyTailed, Shape, White

SHAPES: tuple[Shape, ...] = (White(), Correlated(0.9, 0.6), HeavyTailed(3.0))
TASKS = tuple(EpisodeTask(index, 500 + index, PriorSource()) for index in range(4))

MakeEngine = Callable[..., Any]


@pytest.fixture
def overtaken(small_cut_in: Any, plug_in: Callable[..., None]) -> str:
    """A scenario in which a car falls back past one that pulls away: the nearest one changes."""

    class Overtaken(type(small_cut_in)):  # type: ignore[misc]
        def __call__(self, parameters: Any, seed: int) -> Any:
            situation = super().__call__(parameters, seed)
            away = VehicleState(30.0, 3.5, 0.0, 32.0, 5.0, 2.0)
            back = VehicleState(60.0, 7.0, 0.0, 15.0, 5.0, 2.0)
            return msgspec.structs.replace(situation, actors=(away, back))

        class Staged(type(small_cut_in).Staged, frozen=True):  # type: ignore[misc, name-defined]
            def move_actor(self, actor: int, step: int, ego: VehicleState) -> VehicleState:
                start = self.actors[actor]
                x_m = start.x_m + 0.1 * step * start.speed_mps
                return msgspec.structs.replace(start, x_m=x_m)

    plug_in(plugins.SCENARIOS, "overtaken", Overtaken)
    return "overtaken"


def run(engine: Any, *tasks: EpisodeTask) -> list[EpisodeResult]:
    results = list(engine.run(tasks))
    assert [each.outcome for each in results if each.outcome is Outcome.ERRORED] == []
    return results


def nearest_of(result: EpisodeResult) -> list[int]:
    """By the truth before each step, by hand."""
    vehicles = result.scene.vehicles[: result.steps].astype(float)
    return [
        1 + int(np.argmin([hypot(x - ego[0], y - ego[1]) for x, y, *_ in others]))
        for ego, *others in vehicles
    ]


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_a_replay_of_its_z_is_the_episode_bit_for_bit(
    make_engine: MakeEngine, shape: Shape
) -> None:
    engine = make_engine(disturbance=DisturbanceModel(scale=1.5, shape=shape), scene_every=1)
    first = run(engine, *TASKS)
    again = run(
        engine, *(EpisodeTask(90 + r.index, r.seed, TrajectorySource(r.noise.z)) for r in first)
    )
    assert [each.digest() for each in again] == [each.digest() for each in first]
    for one, other in zip(first, again, strict=True):
        assert one.noise.shape == other.noise.shape == shape
        assert one.noise.injected.tobytes() == other.noise.injected.tobytes()
        assert one.scene.perceived.tobytes() == other.scene.perceived.tobytes()


def test_shapes_share_the_draws_and_differ_in_what_is_injected(make_engine: MakeEngine) -> None:
    found = [
        run(make_engine(disturbance=DisturbanceModel(shape=shape)), TASKS[0])[0].noise
        for shape in SHAPES
    ]
    steps = min(len(noise.z) for noise in found)
    assert all(np.array_equal(noise.z[:steps], found[0].z[:steps]) for noise in found)
    assert len({noise.injected[:steps].tobytes() for noise in found}) == len(SHAPES)


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_noise_is_on_the_nearest_vehicle_also_once_it_is_another_one(
    make_engine: MakeEngine, overtaken: str, steady: type, shape: Shape
) -> None:
    model = DisturbanceModel(scale=0.5, shape=shape)
    engine = make_engine(steady, scenario=overtaken, disturbance=model, scene_every=1)
    (result,) = run(engine, TASKS[0])
    nearest = nearest_of(result)
    assert nearest[0] == 1
    assert nearest[-1] == 2
    assert nearest == sorted(nearest)
    steps = np.arange(result.steps)
    ego, actor = result.scene.vehicles[steps, 0], result.scene.vehicles[steps, nearest]
    injected = result.scene.perceived - actor[:, :2]
    np.testing.assert_allclose(injected, result.noise.injected, atol=1e-4)
    apart = np.abs(actor[:, :2] - ego[:, :2])
    expected = 0.5 * (apart * [0.02, 0.00625] + [1.0, 0.2])
    np.testing.assert_allclose(result.noise.sigma, expected, rtol=1e-4)


def test_correlated_noise_goes_on_over_the_change(
    make_engine: MakeEngine, overtaken: str, steady: type
) -> None:
    shape = Correlated(0.9, 0.6)
    engine = make_engine(
        steady, scenario=overtaken, disturbance=DisturbanceModel(shape=shape), scene_every=1
    )
    (result,) = run(engine, TASKS[1])
    change = nearest_of(result).index(2)
    before, after = result.noise.standardised[change - 1 : change + 1]
    z = result.noise.z[change]
    assert after[0] == pytest.approx(0.9 * before[0] + (1.0 - 0.81) ** 0.5 * z[0])
    assert after[1] == pytest.approx(0.6 * before[1] + 0.8 * z[1])


def test_a_result_knows_its_shape_even_if_it_broke(
    make_engine: MakeEngine, faulty: Callable[..., type]
) -> None:
    shape = HeavyTailed(3.0)
    broken = faulty(lambda: "nothing")
    engine = make_engine(broken, disturbance=DisturbanceModel(shape=shape))
    _, result = engine.run(TASKS[:2])
    assert result.outcome is Outcome.ERRORED
    assert result.steps == 5
    assert result.noise.shape == shape
