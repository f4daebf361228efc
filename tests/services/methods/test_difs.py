"""DiFS learns, keeps to what is likely, and copes with odd data."""

import numpy as np
import pytest
import torch

from eigenfail.errors import LearnerFailed, ProtocolError
from eigenfail.settings import read_settings
from eigenfail.testing.toy import Corridor
from eigenfail.values import LearnerContext, PriorSource, TrajectorySource
from eigenfail_services.methods.difs.method import DiffusionFailureSampling

CORRIDOR = Corridor()

QUICK = {"first_steps": 20, "steps": 10, "device": "cpu"}


def difs(episodes=100, horizon=5, **settings):
    nothing = np.zeros((0, horizon, 2), np.float32)
    given = read_settings(DiffusionFailureSampling.Settings, {**QUICK, **settings}, "settings")
    return DiffusionFailureSampling(LearnerContext(0, episodes, horizon, nothing), given)


def test_finds_likely_failures_where_the_prior_finds_next_to_none(campaign, prior_failure_rate):
    prior = prior_failure_rate(CORRIDOR)
    assert prior < 1e-3
    results = campaign(DiffusionFailureSampling, CORRIDOR, 400, seed=1, device="cpu")
    failures = [result for result in results if result.is_failure]
    final = [result.is_failure for result in results[-80:]]
    assert len(failures) / len(results) >= 5 * max(prior, 1 / 400)
    assert np.mean(final) >= 0.15
    # sigma is (2, 0.4) throughout: the prior's log p per step, in expectation.
    expected = -np.log(2.0 * 0.4 * 2.0 * np.pi) - 1.0
    found = sum(r.noise.log_probability for r in failures) / sum(r.steps for r in failures)
    assert 0.8 <= found / expected <= 1.5


def test_goes_from_the_prior_over_rounds_to_samples_at_robustness_zero(episode):
    learner = difs(initial_share=0.3, final_share=0.25, round_size=20)
    kinds = []
    left = 100
    while left:
        sources = learner.propose(left).sources
        kinds.append((type(sources[0]), len(sources)))
        left -= len(sources)
        learner.observe([episode(np.zeros((5, 2)), 2.0 + i) for i in range(len(sources))])
    prior, sampled = PriorSource, TrajectorySource
    assert kinds == [(prior, 30), (sampled, 20), (sampled, 20), (sampled, 5), (sampled, 25)]


def test_the_threshold_is_the_newest_rounds_quantile_and_never_rises(episode):
    learner = difs(quantile=0.25)
    seen = []
    for robustness in ([8.0, 4.0, 6.0, 10.0, 12.0], [5.0, 3.0, 9.0], [9.0, 9.0], [0.0, 0.0]):
        learner.propose(10)
        learner.observe([episode(np.zeros((5, 2)), r) for r in robustness])
        seen.append(learner._facts.threshold_m)
    assert seen == [6.0, 4.0, 4.0, 0.0]
    assert learner._facts.scale_m == 8.0


@pytest.mark.parametrize("robustness", [0.0, 5.0])
def test_all_failures_or_constant_robustness_are_learnt_from(episode, robustness):
    learner = difs()
    for _ in range(3):
        sources = learner.propose(20).sources
        learner.observe([episode(np.zeros((5, 2)), robustness) for _ in sources])
    for source in learner.propose(20).sources:
        assert np.isfinite(source.z).all()


def test_a_weight_that_becomes_nan_ends_the_learner_with_a_remedy(episode):
    learner = difs()
    learner.propose(10)
    with torch.no_grad():
        learner._model._denoiser.shift.weight[0] = float("nan")
    with pytest.raises(LearnerFailed, match=r"diverged.*Lower learning_rate"):
        learner.observe([episode(np.zeros((5, 2)), 1.0)])


def test_a_state_of_another_horizon_is_refused():
    with pytest.raises(ProtocolError, match="should have shape"):
        difs(horizon=5).restore(difs(horizon=6).state())


def test_proposals_do_not_depend_on_what_else_draws_from_torch(episode):
    def proposed(disturb):
        learner = difs(initial_share=0.1)
        learner.propose(100)
        disturb()
        learner.observe([episode(np.ones((5, 2)), float(i)) for i in range(10)])
        disturb()
        return np.stack([source.z for source in learner.propose(90).sources])

    before = torch.random.get_rng_state()
    np.testing.assert_array_equal(proposed(lambda: None), proposed(lambda: torch.rand(3)))
    torch.random.set_rng_state(before)
