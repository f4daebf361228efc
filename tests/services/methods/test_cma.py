"""`cma`: held values, ranks, turns of the runs, starts after an end, and states."""

import numpy as np
import pytest

from eigenfail.errors import InvalidValue
from eigenfail.functions import of_batch
from eigenfail.settings import read_settings
from eigenfail.testing.learner import ToyEngine
from eigenfail.values.episode import EpisodeTask, TrajectorySource, episode_seed
from eigenfail.values.learning import LearnerContext
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.methods.cma import (
    CovarianceAdaptation,
    Score,
    level_failures,
    score_episode,
)
from eigenfail_workers.functions import FunctionEngine


def make_learner(horizon=25, seed=1, episodes=1000, channels=2, **settings):
    nothing = np.zeros((0, horizon, channels), np.float32)
    given = read_settings(CovarianceAdaptation.Settings, settings, "settings")
    return CovarianceAdaptation(LearnerContext(seed, episodes, horizon, nothing), given)


def draw(learner, n):
    return np.stack([source.z for source in learner.propose(n).sources])


def make_engine(robustness, horizon=25):
    return FunctionEngine(of_batch(robustness), horizon)


def play(learner, engine, rounds, first=0):
    """The noise of some rounds, each observed after it was run."""
    noise = []
    for _ in range(rounds):
        proposal = learner.propose(10_000)
        tasks = [
            EpisodeTask(index, episode_seed(0, index), source)
            for index, source in enumerate(proposal.sources, first)
        ]
        first += len(tasks)
        learner.observe(list(engine.run(tasks)))
        noise.append(np.stack([source.z for source in proposal.sources]))
    return noise


def push(z):
    """Distance to a failure by a longitudinal push over all steps."""
    return 2.0 - z[:, :, 0].mean(axis=1)


@pytest.mark.parametrize("channels", [1, 2, 3, 5])
@pytest.mark.parametrize(("horizon", "hold"), [(25, 10), (30, 10), (7, 10), (25, 1)])
def test_a_value_is_held_for_the_steps_of_the_setting_and_the_last_one_to_the_end(
    horizon, hold, channels
):
    noise = draw(make_learner(horizon, hold=hold, channels=channels), 100)
    assert noise.shape == (12, horizon, channels)
    changed = np.diff(noise, axis=1) != 0.0
    places = np.arange(1, horizon) % hold == 0
    assert changed[:, places].all()
    assert not changed[:, ~places].any()


def test_the_first_generation_of_all_runs_is_as_wide_as_held_noise():
    noise = np.concatenate([draw(make_learner(100, seed), 12) for seed in range(300)])
    spread = noise[:, ::10].std(axis=0)
    assert spread == pytest.approx(np.full((10, 2), np.hypot(0.7, 0.7)), rel=0.1)


def test_robustness_ranks_first_and_likelihood_among_failures():
    engine = make_engine(push)
    strong, weak, safe = (np.zeros((25, 2), np.float32) for _ in range(3))
    strong[:, 0], weak[:, 0], safe[:, 1] = 3.0, 2.5, 0.1
    run = engine.run(
        [EpisodeTask(i, i, TrajectorySource(z)) for i, z in enumerate([strong, weak, safe])]
    )
    scores = [score_episode(result) for result in run]
    assert scores[1] < scores[0] < scores[2] < Score(np.inf, np.inf)
    assert scores[1].squares == pytest.approx(25 * 2.5**2)


def test_noise_counts_up_to_the_end_of_the_episode_only():
    z = np.full((40, 2), 3.0, np.float32)
    (result,) = ToyEngine().run([EpisodeTask(0, 0, TrajectorySource(z))])
    assert result.steps < 10
    assert score_episode(result).squares == pytest.approx(result.steps * 2 * 9.0)


def test_failures_rank_equal_in_a_generation_of_which_too_few_failed():
    likely, unlikely, near, far = Score(0.0, 2.0), Score(0.0, 9.0), Score(1.0, 3.0), Score(4.0, 1.0)
    generation = [near, unlikely, far, likely]
    assert level_failures(generation, 0.5) == generation
    assert level_failures(generation, 0.51) == [near, Score(0.0, 0.0), far, Score(0.0, 0.0)]
    assert level_failures([near, far], 1.0) == [near, far]
    assert level_failures([likely, unlikely], 1.0) == [likely, unlikely]


def test_with_a_failing_share_more_episodes_fail_and_failures_are_less_likely():
    def search(share):
        learner = make_learner(runs=1, failing_share=share)
        results = list(run_in_process(Rounds(learner, 1, 600), make_engine(push)))
        failures = [result for result in results[200:] if result.is_failure]
        squares = [np.sum(one.noise.z.astype(float) ** 2) for one in failures]
        return len(failures), np.mean(squares)

    (few, likely), (many, unlikely) = search(0.0), search(1.0)
    assert few < 330
    assert many > 345
    assert likely < unlikely


def test_runs_take_turns_and_none_depends_on_the_results_of_another():
    """However many rounds are open, the noise is the same."""
    settings = {"runs": 3, "population": 5}
    engine = make_engine(push)
    apart = list(run_in_process(Rounds(make_learner(**settings), 1, 90), engine))
    waiting = make_learner(**settings)
    waiting.lookahead = 0
    one_by_one = list(run_in_process(Rounds(waiting, 1, 90), engine))
    assert make_learner(**settings).lookahead == 2
    for result, other in zip(apart, one_by_one, strict=True):
        assert np.array_equal(result.noise.z, other.noise.z)


def test_a_generation_may_be_asked_for_in_pieces():
    whole, pieces = make_learner(population=5), make_learner(population=5)
    for learner in (whole, pieces):
        learner.lookahead = 0
    (noise,) = play(whole, make_engine(push), 1)
    parts = [draw(pieces, 2)]
    # The other runs have their turns in between.
    for _ in range(4):
        draw(pieces, 5)
    parts.append(draw(pieces, 100))
    assert [len(part) for part in parts] == [2, 3]
    assert np.array_equal(np.concatenate(parts), noise)


def test_a_run_that_has_converged_starts_anew_elsewhere():
    learner = make_learner(horizon=2, runs=1, hold=2, population=6, converged=0.3)
    noise = [
        z[:, 0] for z in play(learner, make_engine(lambda z: 9 + np.abs(z).sum((1, 2)), 2), 80)
    ]
    widths = np.array([generation.std(axis=0).max() for generation in noise])
    centres = np.array([generation.mean(axis=0) for generation in noise])
    starts = np.flatnonzero(widths[1:] > 2.5 * widths[:-1]) + 1
    assert 2 <= len(starts) <= 30
    assert len({tuple(np.round(centres[start], 3)) for start in starts}) == len(starts)


def test_no_generation_is_wider_than_the_largest_standard_deviation():
    """A failure far away, to which the strategy would take ever larger steps."""
    learner = make_learner(runs=1, max_std=0.5, population=40)
    noise = play(learner, make_engine(lambda z: 1e3 - z[:, :, 0].mean(axis=1)), 30)
    for generation in noise[1:]:
        assert np.linalg.eigvalsh(np.cov(generation[:, ::10].reshape(40, -1).T))[-1] < 4 * 0.5**2
    assert noise[-1].mean(axis=(0, 1))[0] > 3.0


def fragile(z):
    """A push, where noise far to one side cannot be run."""
    r = push(z)
    if z[0, 0, 1] > 0.5:
        raise FloatingPointError("too far")
    return r


def test_episodes_that_could_not_be_run_rank_last():
    learner = make_learner(runs=1, first_spread=0.0)
    results = list(run_in_process(Rounds(learner, 1, 600), make_engine(fragile)))
    errored = [result.fault is not None for result in results]
    assert sum(errored[:60]) > 5
    assert sum(errored[-200:]) < sum(errored[:200])
    assert sum(result.is_failure for result in results) > 200


def test_a_generation_without_an_episode_that_ran_is_drawn_again():
    def broken(z):
        raise FloatingPointError("never")

    learner = make_learner(runs=1)
    first, second = play(learner, make_engine(broken), 2)
    assert not np.array_equal(first, second)
    assert np.std(second) == pytest.approx(np.std(first), rel=0.3)
    found = play(learner, make_engine(push), 40, 24)
    assert (push(found[-1]) <= 0.0).any()


@pytest.mark.parametrize("rounds", [0, 1, 7, 31])
def test_a_state_holds_everything_with_rounds_open(rounds):
    learner, engine = make_learner(runs=3, population=6), make_engine(push)
    play(learner, engine, rounds)
    opened = learner.propose(4)
    other = make_learner(runs=3, population=6)
    other.restore(learner.state())
    tasks = [EpisodeTask(i, i, source) for i, source in enumerate(opened.sources)]
    for one in (learner, other):
        one.observe(list(engine.run(tasks)))
    expected, found = (play(one, engine, 12) for one in (learner, other))
    assert all(map(np.array_equal, expected, found))
    assert learner.state() == other.state()


def test_settings_that_give_too_large_matrices_are_refused():
    with pytest.raises(InvalidValue, match=r"settings\.hold: 1 steps give 1000 values.*5,000,000"):
        make_learner(horizon=500, hold=1)
    make_learner(horizon=500, hold=1, runs=1)
    with pytest.raises(InvalidValue, match="1 steps give 1000 values"):
        make_learner(horizon=200, channels=5, hold=1)
