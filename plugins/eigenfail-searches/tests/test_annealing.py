"""`annealing`: moves, what is accepted, starts after many failures, and what failures are like."""

import numpy as np
import pytest

from eigenfail.functions import of_batch
from eigenfail.settings import read_settings
from eigenfail.testing.learner import ToyEngine
from eigenfail.values.episode import EpisodeTask, episode_seed
from eigenfail.values.learning import LearnerContext
from eigenfail_searches.annealing import SimulatedAnnealing
from eigenfail_workers.functions import FunctionEngine

MEAN_BEYOND_2 = 2.3732
"""Mean of a standard normal number above 2."""


def make_learner(horizon=25, seed=1, channels=2, **settings):
    nothing = np.zeros((0, horizon, channels), np.float32)
    given = read_settings(SimulatedAnnealing.Settings, settings, "settings")
    return SimulatedAnnealing(LearnerContext(seed, 1000, horizon, nothing), given)


def make_engine(robustness, horizon=25):
    return FunctionEngine(of_batch(robustness), horizon)


def play(learner, engine, rounds):
    """Noise of shape (rounds, runs, steps, channels), and whether each episode failed."""
    noise, failed = [], []
    for number in range(rounds):
        sources = learner.propose(10_000).sources
        tasks = [
            EpisodeTask(index, episode_seed(0, index), source)
            for index, source in enumerate(sources, number * len(sources))
        ]
        results = list(engine.run(tasks))
        learner.observe(results)
        noise.append(np.stack([source.z for source in sources]))
        failed.append([result.is_failure for result in results])
    return np.stack(noise), np.array(failed)


def push(z):
    """Distance to a failure by a longitudinal push at the first step."""
    return np.maximum(2.0 - z[:, 0, 0], 0.0)


@pytest.mark.parametrize("channels", [1, 2, 5])
@pytest.mark.parametrize(("horizon", "hold"), [(25, 10), (7, 10), (25, 1)])
def test_a_value_is_held_for_the_steps_of_the_setting(horizon, hold, channels) -> None:
    learner = make_learner(horizon, hold=hold, channels=channels, runs=50)
    noise, _ = play(learner, make_engine(push, horizon), 2)
    assert noise.shape == (2, 50, horizon, channels)
    changes = np.diff(noise, axis=2).any(axis=(0, 1, 3))
    assert set(np.flatnonzero(changes) + 1) == set(range(hold, horizon, hold))


def test_failures_are_draws_of_p_beyond_the_border() -> None:
    learner = make_learner(horizon=1, hold=1, runs=60, restart=100_000)
    noise, failed = play(learner, make_engine(push, 1), 200)
    late = np.arange(200) >= 100
    pushes, others = noise[late, :, 0, 0], noise[late, :, 0, 1]
    # Each refused move leaves the run where it was, so that its point counts again: the sample of
    # failures is near p(z | failure), but not exactly it.
    assert failed[late].mean() > 0.6
    assert pushes[failed[late]].mean() == pytest.approx(MEAN_BEYOND_2, abs=0.1)
    # Points of a run are alike: sixty runs are some three hundred independent draws.
    assert others.mean() == pytest.approx(0.0, abs=4 / np.sqrt(300))
    assert others.std() == pytest.approx(1.0, abs=4 / np.sqrt(2 * 300))


@pytest.mark.parametrize("acceptance", [0.3, 0.7, 0.95])
def test_the_share_of_failures_follows_the_acceptance(acceptance) -> None:
    settings = {"acceptance": acceptance, "restart": 100_000}
    learner = make_learner(horizon=1, hold=1, runs=30, **settings)
    _, failed = play(learner, make_engine(push, 1), 250)
    assert failed[150:].mean() == pytest.approx(acceptance, abs=0.06)


def test_a_run_starts_anew_after_its_failures() -> None:
    learner = make_learner(hold=25, runs=1, restart=3)
    noise, _ = play(learner, make_engine(lambda z: np.zeros(len(z))), 300)
    starts = noise[::3, 0, 0, :].reshape(-1)
    # Points of one chain would be alike; these are independent draws of N(0, 1).
    assert abs(np.corrcoef(starts[:-2], starts[2:])[0, 1]) < 4 / np.sqrt(len(starts))
    assert starts.std() == pytest.approx(1.0, abs=4 / np.sqrt(2 * len(starts)))


def test_a_run_leaves_a_local_minimum_by_a_new_start() -> None:
    def trap(z):
        """A failure beyond 2 sigma, and a local minimum at the most likely noise."""
        x = z[:, 0, 0]
        return np.where(x > 2.0, 0.0, 1.0 + np.abs(x))

    learner = make_learner(horizon=1, hold=1, runs=20, restart=100_000)
    _, failed = play(learner, make_engine(trap, 1), 1_000)
    # Of the first starts one in twelve reaches the failure.
    assert failed.any(axis=0).mean() > 0.3


def test_a_hot_run_moves_away_from_a_failure_and_a_cold_one_does_not() -> None:
    shares = {}
    for temperature in (100.0, 0.01):
        settings = {"temperature": temperature, "cooling": 100_000, "restart": 100_000}
        learner = make_learner(horizon=1, hold=1, runs=30, **settings)
        shares[temperature] = play(learner, make_engine(push, 1), 150)[1][75:].mean()
    assert shares[100.0] < 0.1
    assert shares[0.01] > 0.6


def test_an_episode_that_could_not_be_run_is_never_accepted() -> None:
    def sometimes(z):
        """No number beside the line z = 0, so that a run that went there would stay there."""
        return np.where(z[:, 0, 0] < 0.0, np.nan, push(z))

    learner = make_learner(horizon=1, hold=1, runs=40, restart=100_000)
    noise, failed = play(learner, make_engine(sometimes, 1), 150)
    assert failed[100:].mean() > 0.5
    assert (noise[:, :, 0, 0] < 0.0).any()


def test_fewer_episodes_than_runs_move_the_first_runs_alone() -> None:
    learner = make_learner(runs=5)
    engine = ToyEngine()
    whole = [source.z for source in learner.propose(5).sources]
    few = learner.propose(2).sources
    assert [source.z.tolist() for source in few] == [z.tolist() for z in whole[:2]]
    tasks = [EpisodeTask(i, episode_seed(0, i), source) for i, source in enumerate(few)]
    learner.observe(list(engine.run(tasks)))
    after = [source.z for source in learner.propose(5).sources]
    assert not np.array_equal(after[0], whole[0])
    assert np.array_equal(after[2], whole[2])
