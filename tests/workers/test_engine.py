"""Episodes of a campaign: reproducible, independent of each other, never in the way."""

from collections.abc import Callable
from math import log, pi, sqrt
from typing import Any

import numpy as np
import pytest

from eigenfail.contracts import EpisodeEngine
from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.values.episode import (
    EpisodeResult,
    EpisodeTask,
    Importance,
    Outcome,
    PolicySource,
    PriorSource,
    Source,
    TrajectorySource,
    episode_seed,
)
from eigenfail.values.learning import MOST_POLICIES, STATE, Layer, Policy
from eigenfail.values.scene import VehicleState

MakeEngine = Callable[..., EpisodeEngine]

SIMULATORS = ("highway", "point_mass")
CLOSE = {"gap_m": 34.0, "slower_mps": 12.0, "sway_m": 6.0}
"""Parameters for which some of the episodes end in a collision."""


def policy(version: int = 1, hold: int = 4) -> Policy:
    rng = np.random.default_rng([1, version])

    def layer(rows: int, columns: int) -> Layer:
        weight, bias = rng.normal(0.0, 0.4, (rows, columns)), rng.normal(0.0, 0.4, rows)
        return Layer(weight.astype(np.float32), bias.astype(np.float32))

    hidden = (layer(32, len(STATE)), layer(32, 32))
    return Policy(version, hidden, layer(2, 32), layer(2, 32), 3.0, hold)


def trajectory(seed: int) -> TrajectorySource:
    z = np.random.default_rng(seed).standard_normal((40, 2)).astype(np.float32)
    return TrajectorySource(z)


SOURCES: dict[str, Callable[[int], Source]] = {
    "prior": lambda _: PriorSource(),
    "trajectory": trajectory,
    "policy": lambda _: PolicySource(1),
}


def tasks(n: int, kind: str = "prior") -> list[EpisodeTask]:
    return [EpisodeTask(i, episode_seed(11, i), SOURCES[kind](i)) for i in range(n)]


def run(engine: EpisodeEngine, todo: list[EpisodeTask]) -> list[EpisodeResult]:
    engine.add_policy(policy())
    return list(engine.run(todo))


def digests(results: list[EpisodeResult]) -> list[str]:
    return [result.digest() for result in results]


@pytest.mark.parametrize("kind", SOURCES)
@pytest.mark.parametrize("simulator", SIMULATORS)
def test_a_replay_is_the_same_bit_for_bit(
    simulator: str, kind: str, make_engine: MakeEngine
) -> None:
    engine = make_engine(simulator=simulator, scenario_parameters=CLOSE)
    results = run(engine, tasks(12, kind))
    assert {result.outcome for result in results} == {Outcome.COLLISION, Outcome.SAFE}
    again = [EpisodeTask(90 + r.index, r.seed, TrajectorySource(r.noise.z)) for r in results]
    replayed = list(engine.run(again))
    assert digests(replayed) == digests(results)
    assert {result.source for result in replayed} == {"trajectory"}
    assert {result.source for result in results} == {kind}


@pytest.mark.parametrize("kind", SOURCES)
@pytest.mark.parametrize("simulator", SIMULATORS)
def test_an_episode_does_not_depend_on_its_neighbours(
    simulator: str, kind: str, make_engine: MakeEngine
) -> None:
    todo = tasks(14, kind)
    whole = digests(run(make_engine(simulator=simulator), todo))
    sevens = [
        digest
        for part in (todo[:7], todo[7:])
        for digest in digests(run(make_engine(simulator=simulator), part))
    ]
    alone = [digests(run(make_engine(simulator=simulator), [task]))[0] for task in todo]
    backwards = digests(run(make_engine(simulator=simulator), todo[::-1]))[::-1]
    assert whole == sevens == alone == backwards
    assert len(set(whole)) == len(whole)


def test_results_come_one_by_one_in_the_order_of_the_tasks(make_engine: MakeEngine) -> None:
    stream = make_engine().run([EpisodeTask(i, i, PriorSource()) for i in (5, 2, 9)])
    assert next(iter(stream)).index == 5
    assert [result.index for result in stream] == [2, 9]


def test_the_seed_gives_the_noise(make_engine: MakeEngine) -> None:
    same = [EpisodeTask(index, 4, PriorSource()) for index in range(2)]
    first, second = run(make_engine(), same)
    assert first.digest() == second.digest()
    assert first.wall_s > 0.0


def test_a_steady_truck_crashes_as_worked_out_by_hand(
    make_engine: MakeEngine, steady: type
) -> None:
    engine = make_engine(steady)
    z = np.array([[1.0, -2.0]], np.float32)
    (result,) = run(engine, [EpisodeTask(0, 0, TrajectorySource(z))])
    # 30 m at 8 m/s: used up after 3.75 s; the last gap before is 30 - 37 · 0.8 = 0.4 m
    assert (result.outcome, result.steps, result.is_failure) == (Outcome.COLLISION, 38, True)
    assert result.measures.robustness_m == 0.0
    assert result.measures.severity == pytest.approx(64.0)
    assert result.measures.min_ttc_s == pytest.approx(0.4 / 8.0)
    assert result.measures.max_drac_mps2 == pytest.approx(64.0 / 0.8)
    assert result.noise.sigma[0] == pytest.approx([0.02 * 40.5 + 1.0, 0.00625 * 3.5 + 0.2])
    assert result.noise.injected[0] == pytest.approx([1.81, -2.0 * 0.221875])
    assert result.noise.z[1:].tolist() == [[0.0, 0.0]] * 37
    assert result.scene.perceived[0] == pytest.approx([42.31, 3.5 - 0.44375])


def of_row(row: np.ndarray, size: np.ndarray) -> VehicleState:
    return VehicleState(*row.tolist(), *size.tolist())


@pytest.mark.parametrize("simulator", SIMULATORS)
def test_measures_follow_from_what_is_stored(
    simulator: str, make_engine: MakeEngine, edge_distance: Callable[..., float]
) -> None:
    engine = make_engine(simulator=simulator, scenario_parameters=CLOSE, scene_every=1)
    results = run(engine, tasks(8))
    assert {result.outcome for result in results} == {Outcome.COLLISION, Outcome.SAFE}
    for result in results:
        scene = result.scene
        states = [
            [of_row(row, size) for row, size in zip(rows, scene.sizes, strict=True)]
            for rows in scene.vehicles
        ]
        distances = [[edge_distance(ego, other) for other in rest] for ego, *rest in states]
        robustness = min(map(min, distances))
        assert result.measures.robustness_m == pytest.approx(robustness, abs=1e-4)
        if result.is_failure:
            touched = 1 + int(np.argmin(distances[-1]))
            poses = scene.vehicles[-1].astype(np.float64)
            v = poses[:, 3] * np.exp(1j * poses[:, 2])
            severity = abs(v[0] - v[touched]) ** 2
            assert result.measures.severity == pytest.approx(severity, rel=1e-4)
        else:
            assert result.measures.severity is None


@pytest.mark.parametrize("simulator", SIMULATORS)
def test_noise_follows_from_what_is_stored(simulator: str, make_engine: MakeEngine) -> None:
    (result,) = run(make_engine(simulator=simulator, scene_every=1), tasks(1))
    scene = result.scene
    assert scene.vehicles.shape == (result.steps + 1, 3, 4)
    ego, actor = scene.vehicles[:-1, 0, :2], scene.vehicles[:-1, 1, :2]
    distance = np.abs(actor - ego)
    sigma = distance * [0.02, 0.00625] + [1.0, 0.2]
    assert result.noise.sigma == pytest.approx(sigma, rel=1e-5)
    a = scene.perceived - actor
    assert result.noise.injected == pytest.approx(a, abs=1e-4)
    log_p = sum(
        -0.5 * (x / s) ** 2 - log(s * sqrt(2.0 * pi))
        for x, s in zip(a.ravel().tolist(), sigma.ravel().tolist(), strict=True)
    )
    assert result.noise.log_probability == pytest.approx(log_p, rel=1e-3)


def test_states_are_what_the_adversary_saw(make_engine: MakeEngine) -> None:
    engine = make_engine(scene_every=1)
    (result,) = run(engine, tasks(1, "policy"))
    ego, actor = result.scene.vehicles[:-1, 0], result.scene.vehicles[:-1, 1]
    assert result.states.shape == (result.steps, len(STATE))
    assert result.states[:, 0] == pytest.approx((actor[:, 0] - ego[:, 0]) / 100.0, abs=1e-5)
    assert result.states[:, 3] == pytest.approx(actor[:, 3] / 30.0, abs=1e-5)
    assert result.states[:, STATE.index("progress")] == pytest.approx(
        np.arange(result.steps) / 60.0, abs=1e-6
    )
    held = result.noise.z[: result.steps // 4 * 4].reshape(-1, 4, 2)
    assert (held == held[:, :1]).all()
    (prior,) = run(engine, tasks(1))
    assert prior.states is None


def test_scenes_are_kept_of_collisions_and_of_every_nth_episode(make_engine: MakeEngine) -> None:
    engine = make_engine(scenario_parameters=CLOSE, scene_every=5)
    results = run(engine, tasks(12))
    assert any(result.is_failure and result.index % 5 for result in results)
    for result in results:
        assert (result.scene is not None) == (result.is_failure or result.index % 5 == 0)


def test_the_newest_policies_are_kept(make_engine: MakeEngine) -> None:
    engine = make_engine()
    for version in range(MOST_POLICIES + 1):
        engine.add_policy(policy(version))
    todo = [EpisodeTask(i, 1, PolicySource(v)) for i, v in enumerate((0, 1, MOST_POLICIES))]
    outcomes = [result.outcome for result in engine.run(todo)]
    assert outcomes[0] is Outcome.ERRORED
    assert Outcome.ERRORED not in outcomes[1:]


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"simulator": "lowway"}, UnknownName),
        ({"scenario": "cut_out"}, UnknownName),
        ({"scenario_parameters": {"gap": 1.0}}, UnknownName),
        ({"planner_settings": {"braking_mps2": "hard"}}, InvalidValue),
    ],
)
def test_what_does_not_exist_is_refused_at_once(
    changes: dict[str, Any], error: type[Exception], make_engine: MakeEngine
) -> None:
    with pytest.raises(error):
        make_engine(**changes)


@pytest.mark.parametrize("simulator", SIMULATORS)
def test_importance_comes_where_it_is_asked_for_and_changes_nothing(
    make_engine: MakeEngine, simulator: str
) -> None:
    plain = trajectory(3)
    asking = TrajectorySource(plain.z, Importance.DISTANCE)
    engine = make_engine(simulator=simulator, scenario_parameters=CLOSE)
    without, result = engine.run([EpisodeTask(0, 1, source) for source in (plain, asking)])
    assert without.importance is None
    assert result.importance is not None
    assert result.importance.shape == (result.steps,)
    assert result.digest() == without.digest()
    assert result.measures is not None
    nearest = 0.0 if result.is_failure else result.measures.robustness_m
    assert -result.importance.max() == pytest.approx(nearest, rel=1e-6)
