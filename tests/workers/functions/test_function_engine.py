"""Episodes of a function: what it is given, what becomes of its answers and of its troubles."""

import os
import re
import signal
import threading
import time
from math import sqrt
from statistics import NormalDist

import numpy as np
import pytest

from eigenfail.functions import FunctionUnderTest, of_batch, of_trajectory
from eigenfail.values.disturbance import Conversion, DisturbanceModel
from eigenfail.values.episode import (
    EpisodeTask,
    Outcome,
    PolicySource,
    PriorSource,
    TrajectorySource,
    episode_seed,
)
from eigenfail.values.learning import MOST_POLICIES, STATE, Layer, Policy, count_state
from eigenfail.values.shapes import Correlated, HeavyTailed, White
from eigenfail_workers.functions import FunctionEngine

STEPS = 12
SHAPES = (White(), Correlated(), HeavyTailed())
WEIGHTS = np.random.default_rng(3).standard_normal((STEPS * 2, 40))


@of_trajectory
def half_space(z):
    return 1.0 - z[:, 0].sum() / sqrt(len(z))


@of_batch
def half_spaces(z):
    return 1.0 - z[:, :, 0].sum(axis=1) / sqrt(z.shape[1])


def in_turn(*functions):
    """One function after the other, a call each."""
    left = iter(functions)

    def call(z):
        return next(left)(z)

    return call


@of_batch
def network(z):
    """Products whose last bits depend on the size of the batch, if they are given one."""
    return np.tanh(z.reshape(len(z), -1) @ WEIGHTS).sum(axis=1)


def layer(rows, columns, seed):
    random = np.random.default_rng(seed)
    weight, bias = random.normal(0.0, 0.5, (rows, columns)), random.normal(0.0, 0.5, rows)
    return Layer(weight.astype(np.float32), bias.astype(np.float32))


def policy(version=1, hold=3, channels=2):
    first = layer(16, count_state(channels), 1)
    outputs = layer(channels, 16, 2), layer(channels, 16, 3)
    return Policy(version, (first,), *outputs, 2.5, hold)


SOURCES = {
    "prior": lambda _i, _channels: PriorSource(),
    "policy": lambda _i, _channels: PolicySource(1),
    "trajectory": lambda i, channels: TrajectorySource(
        np.full((STEPS, channels), 0.1 * i, np.float32)
    ),
}


def tasks(count, kind="prior", channels=2):
    return [EpisodeTask(i, episode_seed(7, i), SOURCES[kind](i, channels)) for i in range(count)]


def run(function, todo, channels=2, **options):
    engine = FunctionEngine(function, STEPS, channels=channels, **options)
    engine.add_policy(policy(channels=channels))
    return list(engine.run(todo))


def digests(results):
    return [result.digest() for result in results]


@pytest.mark.parametrize("function", [half_space, half_spaces])
def test_an_episode_is_a_failure_where_the_function_answers_zero_or_less(function):
    results = run(function, tasks(200))
    answers = [1.0 - np.float64(r.noise.z)[:, 0].sum() / sqrt(STEPS) for r in results]
    for result, answer in zip(results, answers, strict=True):
        assert result.is_failure == (answer <= 0.0)
        assert result.measures.robustness_m == pytest.approx(max(answer, 0.0))
        assert (result.measures.severity, result.scene, result.steps) == (None, None, STEPS)
    expected = 200 * NormalDist().cdf(-1.0)
    assert abs(sum(r.is_failure for r in results) - expected) < 4 * sqrt(expected)


def test_exactly_zero_is_a_failure():
    (result,) = run(of_trajectory(lambda _: -0.0), tasks(1))
    assert result.outcome is Outcome.COLLISION
    assert str(result.measures.robustness_m) == "0.0"


@pytest.mark.parametrize("shape", SHAPES)
def test_it_is_given_sigma_times_what_the_shape_makes_of_z(shape):
    seen = []
    spy = of_trajectory(lambda z: seen.append(z.copy()) or 1.0)
    (result,) = run(spy, tasks(1), model=DisturbanceModel(scale=2.0, shape=shape))
    conversion = Conversion(shape)
    expected = [conversion.inject(tuple(z), (2.0, 2.0)) for z in result.noise.z.tolist()]
    assert seen[0].shape == (STEPS, 2)
    assert seen[0].tolist() == [list(pair) for pair in expected]
    assert result.noise.log_probability == pytest.approx(
        np.sum(result.noise.log_probability_per_step)
    )


def test_with_the_default_model_that_is_z_itself_and_log_p_its_density():
    seen = []
    (result,) = run(of_trajectory(lambda z: seen.append(z) or 1.0), tasks(1))
    assert np.array_equal(seen[0], result.noise.z.astype(np.float64))
    normal = NormalDist()
    density = sum(np.log(normal.pdf(float(z))) for z in result.noise.z.ravel())
    assert result.noise.log_probability == pytest.approx(density)


@pytest.mark.parametrize("function", [half_space, half_spaces, network])
@pytest.mark.parametrize("kind", SOURCES)
def test_an_episode_does_not_depend_on_its_neighbours(function, kind):
    todo = tasks(64, kind)
    whole = digests(run(function, todo))
    sevens = [d for at in range(0, 64, 7) for d in digests(run(function, todo[at : at + 7]))]
    alone = [digests(run(function, [task]))[0] for task in todo]
    assert whole == sevens == alone
    assert len(set(whole)) == 64


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("kind", SOURCES)
def test_a_replay_is_the_same_bit_for_bit(shape, kind):
    model = DisturbanceModel(shape=shape)
    results = run(half_space, tasks(20, kind), model=model)
    again = [EpisodeTask(r.index, r.seed, TrajectorySource(r.noise.z)) for r in results]
    assert digests(run(half_space, again, model=model)) == digests(results)


@pytest.mark.parametrize("channels", [1, 3, 5])
@pytest.mark.parametrize("shape", [White(), HeavyTailed()])
@pytest.mark.parametrize("kind", SOURCES)
def test_a_function_is_given_as_many_channels_as_it_names(kind, shape, channels):
    seen = []
    spy = of_trajectory(lambda z: seen.append(z.copy()) or float(2.0 - z.max()))
    model = DisturbanceModel(scale=0.5, shape=shape)
    results = run(spy, tasks(20, kind, channels), channels, model=model)
    assert Outcome.ERRORED not in {result.outcome for result in results}
    assert {z.shape for z in seen} == {(STEPS, channels)}
    for result, z in zip(results, seen, strict=True):
        assert result.noise.injected.tolist() == z.tolist()
        assert result.states is None or result.states.shape == (STEPS, count_state(channels))
    again = [EpisodeTask(r.index, r.seed, TrajectorySource(r.noise.z)) for r in results]
    assert digests(run(spy, again, channels, model=model)) == digests(results)


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("kind", ["policy", "trajectory"])
def test_noise_of_another_number_of_channels_fails_its_episode(kind, channels):
    engine = FunctionEngine(half_space, STEPS, channels=channels)
    engine.add_policy(policy(channels=2))
    (result,) = engine.run(tasks(1, kind, channels=2))
    assert result.outcome is Outcome.ERRORED


def test_a_policy_sees_no_scene_but_progress_and_holds_its_choice():
    (result,) = run(half_space, tasks(1, "policy"))
    states = dict(zip(STATE, result.states.T, strict=True))
    assert result.states.shape == (STEPS, len(STATE))
    assert states["progress"] == pytest.approx(np.arange(STEPS) / STEPS)
    for name in ("gap_x", "gap_y", "ego_speed", "actor_speed", "actor_heading"):
        assert not states[name].any()
    assert np.array_equal(result.noise.z[::3], result.noise.z[2::3])
    assert np.abs(result.noise.z).max() <= 2.5


def test_it_cannot_change_the_noise_that_is_kept():
    def spoil(z):
        z[:] = 0.0
        return 1.0

    (result,) = run(of_trajectory(spoil), tasks(1))
    assert result.noise.z.all()


def test_each_result_is_one_call():
    calls = []
    results = run(of_batch(lambda z: calls.append(z.shape) or np.ones(len(z))), tasks(9))
    assert calls == [(1, STEPS, 2)] * 9
    assert [result.index for result in results] == list(range(9))


def raises(_z):
    raise ZeroDivisionError("no\nnumber here")


def leaves(_z):
    raise SystemExit(3)


WRONG = {
    "raises": (
        of_trajectory(raises),
        r"raised number here\. Look at test_function_engine\.py, line \d+",
    ),
    "leaves": (of_trajectory(leaves), "raised SystemExit: 3"),
    "is not a number": (of_trajectory(lambda _: float("nan")), "returned nan"),
    "is beyond what is kept": (of_trajectory(lambda _: 1e300), r"returned 1e\+300.*-1e\+15 to"),
    "is a failure beyond it": (of_trajectory(lambda _: -1e16), r"returned -1e\+16"),
    "is infinite": (of_trajectory(lambda _: float("inf")), "returned inf"),
    "is nothing": (of_trajectory(lambda _: None), r"shape \(\) and type object"),
    "is a truth value": (of_trajectory(lambda _: True), "type bool"),
    "is complex": (of_trajectory(lambda _: 1j), "type complex128"),
    "is one for each step": (of_trajectory(lambda z: z[:, 0]), r"shape \(12,\)"),
    "is a scalar for a batch": (of_batch(lambda _: 1.0), r"numbers of shape \(1,\)"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_no_robustness_is_a_failed_episode_and_the_next_is_run(name):
    wrong, words = WRONG[name]
    right = {(): half_space, (1,): half_spaces}[wrong.leading]
    function = FunctionUnderTest(in_turn(right, wrong, right), wrong.leading)
    results = run(function, tasks(3))
    good = run(right, tasks(3))
    failed = results[1]
    assert digests(results)[::2] == digests(good)[::2]
    assert (failed.outcome, failed.measures) == (Outcome.ERRORED, None)
    assert failed.fault.kind == "simulator"
    assert re.search(words, failed.fault.message)
    assert np.array_equal(failed.noise.z, good[1].noise.z)


def hangs(_z):
    while True:
        try:
            time.sleep(0.01)
        except Exception:  # noqa: BLE001 - the stubbornest of hangs
            continue


@pytest.mark.fault(
    "function under test that hangs",
    group="time",
    outcome="It is interrupted, its episode is errored, and the next episode runs.",
)
def test_a_hang_is_broken_off_and_the_next_episode_is_run():
    began = time.monotonic()
    failed, after = run(of_trajectory(in_turn(hangs, half_space)), tasks(2), limit_s=0.1)
    assert time.monotonic() - began < 5.0
    assert failed.fault.kind == "simulator"
    assert "longer than 0.1 s" in failed.fault.message
    assert after.outcome is not Outcome.ERRORED


def test_a_timer_that_was_set_before_goes_on():
    rung = []
    handler = signal.signal(signal.SIGALRM, lambda *_: rung.append(time.monotonic()))
    others = signal.setitimer(signal.ITIMER_REAL, 0.2)
    began = time.monotonic()
    try:
        run(half_space, tasks(5), limit_s=10.0)
        assert not rung
        while not rung and time.monotonic() - began < 5.0:
            time.sleep(0.01)
    finally:
        signal.signal(signal.SIGALRM, handler)
        signal.setitimer(signal.ITIMER_REAL, *others)
    assert 0.15 < rung[0] - began < 5.0


def test_outside_the_main_thread_there_is_no_limit_and_all_the_rest():
    results = []
    thread = threading.Thread(target=lambda: results.extend(run(half_space, tasks(3))))
    thread.start()
    thread.join()
    assert digests(results) == digests(run(half_space, tasks(3)))


def test_the_oldest_policies_make_room():
    engine = FunctionEngine(half_space, STEPS)
    for version in range(MOST_POLICIES + 1):
        engine.add_policy(policy(version))
    first, last = engine.run(
        [EpisodeTask(0, 0, PolicySource(0)), EpisodeTask(1, 0, PolicySource(MOST_POLICIES))]
    )
    assert (first.outcome, first.fault.kind, first.steps) == (Outcome.ERRORED, "input", 0)
    assert last.fault is None


def test_a_declared_function_is_still_the_function():
    assert half_space.__name__ == "half_space"
    assert half_spaces(np.zeros((3, STEPS, 2))).tolist() == [1.0] * 3


@of_trajectory
def moves_away(z):
    os.chdir("/")
    return 1.0


@pytest.mark.fault(
    "function under test that changes process-wide state",
    group="plug-ins",
    outcome="The episode is errored, and its fault names the function and what it changed.",
)
def test_a_function_that_changes_the_process_is_named(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (result,) = run(moves_away, tasks(1))
    assert (result.outcome, result.fault.kind) == (Outcome.ERRORED, "simulator")
    assert result.measures is None
    assert result.fault.message.startswith(
        "The function 'moves_away' changed process-wide state during the episode: "
        "the current directory, which was "
    )
