"""CEM learns, says with what weight, and copes with odd rounds."""

from statistics import NormalDist

import numpy as np
import pytest

from eigenfail.contracts import Estimator
from eigenfail.errors import ProtocolError
from eigenfail.settings import read_settings
from eigenfail.values.episode import Outcome, learner_seed
from eigenfail.values.learning import LearnerContext
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.methods.cem import CrossEntropyMethod
from eigenfail_services.statistics.importance import NO_ROUND, NOT_YET
from eigenfail_services.statistics.intervals import log_normal

ESTIMATING = {
    "batch": 200,
    "mean_smoothing": 0.3,
    "min_std": 1.0,
    "max_mean": 3.0,
    "mean_window": 1,
}


def cem(episodes=1000, horizon=10, seed=1, **settings):
    nothing = np.zeros((0, horizon, 2), np.float32)
    given = read_settings(CrossEntropyMethod.Settings, settings, "settings")
    context = LearnerContext(learner_seed(seed), episodes, horizon, nothing)
    return CrossEntropyMethod(context, given)


def push(z):
    """Distance to a rare failure by the mean of the longitudinal noise alone."""
    return 3.719 - z[:, :, 0].sum(axis=1) / np.sqrt(z.shape[1])


@pytest.fixture
def searched(noise_engine):
    """A learner at the end of a campaign on a rare failure."""

    def run(episodes, **settings):
        learner = cem(episodes, **settings)
        list(run_in_process(Rounds(learner, 1, episodes), noise_engine(push)))
        return learner

    return run


def play(learner, episode, robustness, n=1000):
    """A round in which every episode has that robustness."""
    sources = learner.propose(n).sources
    learner.observe([episode(source.z, robustness) for source in sources])
    return np.stack([source.z for source in sources])


def half_space(p):
    """Distance to a plane through the noise beyond which lies a share p of all noise."""
    reach = -NormalDist().inv_cdf(p)
    return lambda z: reach - z.reshape(len(z), -1).sum(axis=1) / np.sqrt(z[0].size)


@pytest.mark.parametrize("p", [1e-3, 1e-6])
def test_a_proposal_that_is_no_narrower_than_the_noise_tells_the_probability(noise_engine, p):
    learner = cem(3000, seed=3001, **ESTIMATING)
    list(run_in_process(Rounds(learner, 0, 3000), noise_engine(half_space(p))))
    found = learner.estimate()
    assert isinstance(learner, Estimator)
    around = log_normal(found.probability, found.cv)
    assert around.low <= p <= around.high
    assert around.high / around.low < 1.7
    assert found.cv == pytest.approx((1.0 / found.effective - 1.0 / 1400) ** 0.5)
    assert (found.by, found.episodes, found.problem) == ("importance sampling", 1400, "")
    assert (found.bound, found.interval) == ("lower", None)


def test_of_two_failure_regions_it_tells_a_lower_bound_without_an_interval(noise_engine):
    """It follows one of two equal half spaces, and cannot know that it counts half of the truth."""
    reach = -NormalDist().inv_cdf(5e-4)
    learner = cem(3000, seed=3001, **ESTIMATING)

    def apart(z):
        return reach - np.abs(z.reshape(len(z), -1).sum(axis=1)) / np.sqrt(z[0].size)

    list(run_in_process(Rounds(learner, 0, 3000), noise_engine(apart)))
    found = learner.estimate()
    assert (found.bound, found.interval) == ("lower", None)
    assert found.probability <= 1e-3
    assert found.probability == pytest.approx(5e-4, rel=0.3)
    assert "the true probability may be larger" in found.note


@pytest.mark.parametrize("p", [1e-3, 1e-6])
def test_a_proposal_that_would_tell_a_wrong_probability_tells_none(noise_engine, p):
    """In eighty dimensions with the default settings the sum is wrong tenfold and more."""
    learner = cem(1000, horizon=40, seed=3000)
    list(run_in_process(Rounds(learner, 0, 1000), noise_engine(half_space(p))))
    found, sums = learner.estimate(), learner._sums
    assert np.exp(sums.log_first) / sums.episodes < 0.1 * p
    assert found.probability is found.interval is found.cv is None
    assert found.effective < 20
    assert "a number would be far too small" in found.problem
    assert "method subset" in found.problem


def test_before_half_of_the_budget_is_spent_there_is_nothing_to_tell(noise_engine):
    learner = cem(100, batch=20)
    rounds, engine, said = Rounds(learner, 0, 100), noise_engine(half_space(1e-9)), []
    assert learner.estimate() is None
    while opened := rounds.open():
        rounds.complete(list(engine.run(opened[0].tasks)))
        said.append(learner.estimate())
    assert [one.episodes for one in said] == [0, 0, 0, 20, 40]
    assert {one.problem for one in said[:3]} == {NOT_YET}
    assert "None of the 40 episodes that count was a failure" in said[-1].problem


def test_the_round_that_begins_at_exactly_half_of_the_budget_counts(noise_engine):
    learner = cem(100, batch=25)
    rounds, engine, counted = Rounds(learner, 0, 100), noise_engine(half_space(0.5)), []
    while opened := rounds.open():
        rounds.complete(list(engine.run(opened[0].tasks)))
        counted.append(learner.estimate().episodes)
    assert counted == [0, 0, 25, 50]


def test_one_round_over_the_whole_budget_leaves_nothing_to_weigh(noise_engine):
    learner = cem(100, batch=100)
    list(run_in_process(Rounds(learner, 0, 100), noise_engine(half_space(0.5))))
    assert learner.estimate().problem == NO_ROUND


def test_episodes_that_failed_to_run_do_not_count(noise_engine):
    def half(z):
        return np.arange(len(z)) % 2 == 0

    learner = cem(100, batch=20)
    list(run_in_process(Rounds(learner, 0, 100), noise_engine(half_space(0.5), half)))
    assert learner.estimate().episodes == 20


def test_a_restored_learner_tells_the_same_probability(noise_engine):
    learner = cem(3000, seed=3000, **ESTIMATING)
    list(run_in_process(Rounds(learner, 0, 3000), noise_engine(half_space(1e-3))))
    restored = cem(3000, seed=3000, **ESTIMATING)
    restored.restore(learner.state())
    assert restored.estimate() == learner.estimate()
    assert learner.estimate().probability is not None


def test_exploits_as_many_draws_as_asked_from_the_proposal_as_it_stands(searched):
    learner = searched(400, batch=20)
    known = learner.proposal
    first, second = (np.stack([s.z for s in learner.exploit(2000).sources]) for _ in range(2))
    assert learner.proposal is known
    assert not (first == second).any()
    np.testing.assert_allclose(first.mean(axis=0), known.mean, atol=5 / np.sqrt(2000))
    np.testing.assert_allclose(first.std(axis=0), known.std, rtol=0.1)
    assert np.abs(known.mean).max() > 0.5


def test_a_long_search_has_no_larger_state_than_a_short_one(searched):
    states = [searched(episodes).state() for episodes in (100, 400)]
    assert len(states[0]) == len(states[1])


def test_starts_from_the_prior_and_draws_anew_in_every_round(episode):
    learner = cem(batch=500)
    first = play(learner, episode, 1.0)
    assert abs(first.mean()) < 0.05
    assert first.std() == pytest.approx(1.0, rel=0.03)
    assert not (play(learner, episode, 1.0) == first).any()


def test_another_seed_draws_another_noise():
    draws = [cem(seed=seed).propose(5).sources[0].z for seed in (1, 2)]
    assert not np.isin(*draws).any()


@pytest.mark.parametrize("robustness", [0.0, 5.0])
def test_rounds_in_which_all_fail_or_all_are_as_robust_leave_the_prior_as_it_is(
    episode, robustness
):
    learner = cem()
    for _ in range(5):
        play(learner, episode, robustness)
    assert not learner.proposal.mean.any()
    assert (learner.proposal.std == 1.0).all()


def test_a_round_that_failed_to_run_changes_nothing_but_the_draws(episode):
    learner = cem(batch=40)
    before = learner.propose(40).sources
    learner.observe([episode(source.z, 1.0, outcome=Outcome.ERRORED) for source in before])
    after = learner.propose(40).sources
    assert (learner.proposal.std == 1.0).all()
    assert not learner.proposal.mean.any()
    assert not np.isin(after[0].z, before[0].z).any()


def test_mean_and_standard_deviation_stay_within_their_bounds(searched):
    bounds = {"max_mean": 0.4, "min_std": 0.7, "max_std": 1.1}
    learner = searched(600, std_smoothing=1.0, mean_smoothing=1.0, mean_window=1, **bounds)
    last = learner.proposal
    assert np.abs(last.mean).max() == np.float32(0.4)
    assert last.std.min() == np.float32(0.7)
    assert last.std.max() == np.float32(1.1)


def test_moves_by_the_smoothed_share_of_the_way(episode):
    learner = cem(batch=4, elite_share=0.5, mean_smoothing=0.5, std_smoothing=0.25, min_std=0.1)
    learner.propose(4)
    noise = [np.full((10, 2), x, np.float32) for x in (1.0, 1.5, -1.0, -2.0)]
    learner.observe([episode(z, 1.0 + i) for i, z in enumerate(noise)])
    learner.propose(4)
    moved = learner.proposal
    np.testing.assert_allclose(moved.mean, 0.5 * 1.25, rtol=1e-6)
    np.testing.assert_allclose(moved.std, 0.75 + 0.25 * np.std([1.0, 1.5], ddof=1), rtol=1e-6)


def test_averaging_over_steps_spreads_a_move_and_flattens_no_mean_that_is_reached(episode):
    learner = cem(batch=4, elite_share=0.5, mean_smoothing=1.0, mean_window=3)

    def move_to(centre):
        learner.propose(4)
        noise = [centre + 0.1, centre - 0.1, centre + 1.0, centre + 2.0]
        learner.observe([episode(z, 1.0 + i) for i, z in enumerate(noise)])
        return learner.proposal.mean

    spike = np.zeros((10, 2))
    spike[4] = 1.5
    reached = move_to(spike)
    np.testing.assert_allclose(reached[:, 0], [0, 0, 0, 0.5, 0.5, 0.5, 0, 0, 0, 0], atol=1e-6)
    np.testing.assert_allclose(move_to(reached), reached, atol=1e-6)


def test_a_state_of_another_horizon_is_refused():
    with pytest.raises(ProtocolError, match="should have shape"):
        cem(horizon=5).restore(cem(horizon=6).state())
