"""`optuna`: bounds, what each sampler looks for, its limits, and states before and in a study."""

import numpy as np
import pytest

from eigenfail.errors import InvalidValue
from eigenfail.functions import of_batch
from eigenfail.settings import read_settings
from eigenfail.values.episode import EpisodeTask, TrajectorySource, episode_seed
from eigenfail.values.learning import LearnerContext
from eigenfail_searches.optuna_search import OptunaSearch, score_several, score_single
from eigenfail_services.methods import archive, check_budget
from eigenfail_services.methods.ensemble import Ensemble
from eigenfail_workers.functions import FunctionEngine

STEPS = 20


def make_learner(seed=1, channels=2, **settings):
    nothing = np.zeros((0, STEPS, channels), np.float32)
    given = read_settings(OptunaSearch.Settings, settings, "settings")
    return OptunaSearch(LearnerContext(seed, 1000, STEPS, nothing), given)


def play_round(learner, robustness, first=0):
    """Noise and results of one round."""
    sources = learner.propose(1000).sources
    engine = FunctionEngine(of_batch(robustness), STEPS)
    tasks = [EpisodeTask(i, episode_seed(0, i), each) for i, each in enumerate(sources, first)]
    results = list(engine.run(tasks))
    learner.observe(results)
    return np.stack([source.z for source in sources]), results


def play(learner, robustness, rounds):
    found = [play_round(learner, robustness, 100 * number) for number in range(rounds)]
    return np.concatenate([z for z, _ in found]), [each for _, results in found for each in results]


def push(z):
    """Distance to a failure by a longitudinal push over all steps: a tenth of uniform noise."""
    return np.maximum(1.2 - z[:, :, 0].mean(axis=1), 0.0)


@pytest.mark.parametrize("sampler", ["tpe", "nsga2"])
def test_noise_is_held_and_within_the_amplitude(sampler) -> None:
    learner = make_learner(sampler=sampler, hold=5, amplitude=1.5)
    noise, _ = play(learner, push, 4)
    assert noise.shape == (40, STEPS, 2)
    assert np.abs(noise).max() <= 1.5
    changes = np.diff(noise, axis=1).any(axis=(0, 2))
    assert set(np.flatnonzero(changes) + 1) == {5, 10, 15}


@pytest.mark.parametrize("seed", [1, 2])
def test_tpe_fails_more_often_than_uniform_noise_and_then_with_likelier_noise(seed) -> None:
    noise, results = play(make_learner(seed, hold=10), push, 20)
    failed = np.array([each.is_failure for each in results])
    uniform = np.random.default_rng(seed).uniform(-2.0, 2.0, (10_000, 2, 2)).repeat(10, axis=1)
    assert failed[100:].mean() > 3.0 * (push(uniform) == 0.0).mean()
    squares = (noise**2).mean(axis=(1, 2))
    first, last = (squares[part][failed[part]].mean() for part in (slice(0, 100), slice(150, 200)))
    assert last < first


def test_nsga2_finds_a_front_of_robustness_and_likelihood() -> None:
    learner = make_learner(sampler="nsga2", hold=20, round_size=20)
    _, results = play(learner, push, 20)
    found = np.array([score_several(each) for each in results])
    # On the front the mean of z² is that of the shortest push with this robustness.
    excess = found[:, 1] - (1.2 - found[:, 0]).clip(0.0) ** 2 / 2.0
    assert np.median(excess[-100:]) < 0.4 * np.median(excess[:20])
    assert np.ptp(found[-100:, 0]) > 0.5


def test_failures_rank_by_likelihood_below_all_others() -> None:
    _, results = play(make_learner(hold=10), push, 5)
    single = np.array([score_single(each)[0] for each in results])
    failed = np.array([each.is_failure for each in results])
    squares = np.array([score_several(each)[1] for each in results])
    assert (single[failed] < 0.0).all()
    assert (single[~failed] > 0.0).all()
    assert (np.argsort(single[failed]) == np.argsort(squares[failed])).all()


def test_rounds_in_which_nothing_ran_are_drawn_again() -> None:
    learner = make_learner(hold=10)
    first, _ = play_round(learner, lambda z: np.full(len(z), np.nan))
    again, _ = play_round(learner, push)
    assert not np.array_equal(first, again)
    before = learner.state()
    play_round(learner, push)
    # The state before held the ten results of the second round, and none of the first.
    assert len(archive.read("optuna", before, OptunaSearch._Facts)[1]["points"]) == 10


@pytest.mark.parametrize("rounds", [0, 1, 3])
def test_an_open_round_goes_on_from_a_state(rounds) -> None:
    one, other = make_learner(hold=10), make_learner(hold=10)
    for number in range(rounds):
        play_round(one, push, 100 * number)
    one.propose(1000)
    other.restore(one.state())
    engine = FunctionEngine(of_batch(push), STEPS)
    rng = np.random.default_rng(3)
    z = rng.uniform(-2.0, 2.0, (10, STEPS, 2)).astype(np.float32)
    tasks = [EpisodeTask(i, episode_seed(0, i), TrajectorySource(each)) for i, each in enumerate(z)]
    results = list(engine.run(tasks))
    for each in (one, other):
        each.observe(results)
    proposed = [[source.z.tolist() for source in each.propose(10).sources] for each in (one, other)]
    assert proposed[0] == proposed[1]


def test_a_gaussian_process_has_a_limit() -> None:
    settings = read_settings(OptunaSearch.Settings, {"sampler": "gp"}, "settings")
    check_budget(settings, 500)
    with pytest.raises(InvalidValue, match="episodes: 501 episodes are too many for `gp`"):
        check_budget(settings, 501)
    members = {"method": "optuna", "members": 2, "settings": {"sampler": "gp"}}
    ensemble = read_settings(Ensemble.Settings, members, "settings")
    check_budget(ensemble, 1000)
    with pytest.raises(InvalidValue, match="episodes: 501 episodes are too many"):
        check_budget(ensemble, 1001)


def sometimes(z):
    """As `push`; every fifth episode or so cannot be run."""
    return np.where(np.abs(z[:, 0, 1]) > 1.6, np.nan, push(z))


@pytest.mark.parametrize("robustness", [push, sometimes])
def test_a_genetic_search_goes_on_bit_for_bit_from_each_of_its_rounds(robustness) -> None:
    settings = {"sampler": "nsga2", "hold": 10, "round_size": 10}
    whole, restored = make_learner(**settings), make_learner(**settings)
    for number in range(25):
        fresh = make_learner(**settings)
        fresh.restore(restored.state())
        restored = fresh
        noise = [play_round(each, robustness, 100 * number)[0] for each in (whole, restored)]
        assert np.array_equal(*noise)


def test_many_generations_are_restored() -> None:
    settings = {"sampler": "nsga2", "hold": 20, "round_size": 2}
    learner, other = make_learner(**settings), make_learner(**settings)
    for number in range(500):
        play_round(learner, push, 2 * number)
    other.restore(learner.state())
    assert np.array_equal(play_round(learner, push)[0], play_round(other, push)[0])
