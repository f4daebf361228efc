"""DiFS learns, keeps to what is likely, and copes with odd data."""

import numpy as np
import pytest
import torch

from eigenfail.errors import LearnerDiverged, ProtocolError
from eigenfail.settings import read_settings
from eigenfail.testing.learner import Corridor
from eigenfail.values.episode import PriorSource, TrajectorySource
from eigenfail.values.learning import Experience, LearnerContext
from eigenfail_services.methods import archive
from eigenfail_services.methods.difs.method import DiffusionFailureSampling

CORRIDOR = Corridor()

QUICK = {"first_steps": 20, "steps": 10, "device": "cpu"}


def difs(episodes=100, horizon=5, experience=None, **settings):
    nothing = np.zeros((0, horizon, 2), np.float32)
    given = read_settings(DiffusionFailureSampling.Settings, {**QUICK, **settings}, "settings")
    context = LearnerContext(0, episodes, horizon, nothing, experience=experience)
    return DiffusionFailureSampling(context, given)


def course(learner, episode, episodes):
    """The kinds and sizes of the rounds, each episode of another robustness."""
    kinds, left = [], episodes
    while left:
        sources = learner.propose(left).sources
        kinds.append((type(sources[0]), len(sources)))
        left -= len(sources)
        learner.observe([episode(np.zeros((5, 2)), 2.0 + i) for i in range(len(sources))])
    return kinds


def noise(proposal):
    return np.stack([source.z for source in proposal.sources])


def test_finds_likely_failures_where_the_prior_finds_next_to_none(campaign, prior_failure_rate):
    prior = prior_failure_rate(CORRIDOR)
    assert prior < 1e-3
    results = campaign(DiffusionFailureSampling, CORRIDOR, 400, seed=1, final_share=0.2, **QUICK)
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
    kinds = course(learner, episode, 100)
    prior, sampled = PriorSource, TrajectorySource
    assert kinds == [(prior, 30), (sampled, 20), (sampled, 20), (sampled, 5), (sampled, 25)]


def test_the_threshold_is_the_newest_rounds_quantile_and_never_rises(episode):
    learner = difs(quantile=0.25)
    seen = []
    for robustness in ([8.0, 4.0, 6.0, 10.0, 12.0], [5.0, 3.0, 9.0], [9.0, 9.0], [0.0, 0.0]):
        learner.propose(10)
        learner.observe([episode(np.zeros((5, 2)), r) for r in robustness])
        seen.append(learner._facts.threshold_m)
    assert seen == pytest.approx([6.0, 4.0, 4.0, 0.0])
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
        learner._model._average.first.weight[0] = float("nan")
    with pytest.raises(LearnerDiverged, match=r"diverged.*Lower learning_rate"):
        learner.observe([episode(np.zeros((5, 2)), 1.0)])


def test_samples_that_are_not_finite_never_leave_the_learner(episode):
    learner = difs()
    learner._model.mixture.means[0, 0] = np.inf
    with pytest.raises(LearnerDiverged, match=r"not finite.*Lower"):
        learner.exploit(3)


def test_a_state_of_another_horizon_is_refused():
    with pytest.raises(ProtocolError, match="should have shape"):
        difs(horizon=5).restore(difs(horizon=6).state())


def test_a_state_with_the_weights_of_another_network_is_refused():
    learner = difs()
    facts, arrays = archive.read("difs", learner.state(), learner._Facts)
    renamed = {name.replace(".first.", ".correction.0."): a for name, a in arrays.items()}
    with pytest.raises(ProtocolError, match=r"'denoiser\.first\.weight' should have shape"):
        learner.restore(archive.write("difs", facts, renamed))


def test_the_network_also_learns_from_near_failures_and_failures_have_the_condition_zero(episode):
    learner = difs(episodes=40, elite=2, replay=0.5)
    learner.propose(40)
    robustness = [-3.0, -1.0, 2.0, 4.0, 6.0, 8.0]
    learner.observe([episode(np.full((5, 2), i), r) for i, r in enumerate(robustness)])
    made = learner._make_examples()
    assert made.z[:, 0, 0].tolist() == [0.0, 1.0, 2.0]
    assert made.elite.tolist() == [True, True, False]
    assert made.condition.tolist() == pytest.approx([0.0, 0.0, 2.0 / 3.0])


@pytest.mark.parametrize(("schedule", "trained"), [("many_rounds", False), ("paper", True)])
def test_the_network_waits_for_an_elite_of_failures_unless_the_schedule_is_the_papers(
    episode, schedule, trained
):
    learner = difs(episodes=40, elite=4, schedule=schedule)
    learner.propose(20)
    learner.observe([episode(np.full((5, 2), i), 1.0 + i) for i in range(10)])
    assert learner._model.trained == trained
    learner.propose(20)
    learner.observe([episode(np.full((5, 2), i), 0.0) for i in range(10)])
    assert learner._model.trained


def test_a_threshold_far_beyond_failures_asks_for_samples_at_robustness_zero(episode):
    learner = difs(initial_share=0.1)
    learner.propose(10)
    learner.observe([episode(np.full((5, 2), i), -9.0) for i in range(10)])
    assert len(learner.propose(5).sources) == 5
    assert learner._draw_conditions(5).tolist() == [0.0] * 5


def test_no_gradient_step_leaves_the_mixture_alone(episode):
    learner = trained(episode, first_steps=0, steps=0)
    assert float(learner._model._average.trust) == 0.0
    assert noise(learner.exploit(400)).mean() > 0.5


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


def test_the_papers_preset_is_500_from_the_prior_500_below_the_threshold_and_500_at_zero(episode):
    kinds = course(difs(episodes=1500, schedule="paper"), episode, 1500)
    assert kinds == [(PriorSource, 500), (TrajectorySource, 500), (TrajectorySource, 500)]


def test_the_papers_preset_in_a_smaller_budget_is_two_halves(episode):
    kinds = course(difs(episodes=61, schedule="paper"), episode, 61)
    assert kinds == [(PriorSource, 31), (TrajectorySource, 30)]


def test_the_papers_preset_trains_on_all_below_the_threshold(episode):
    learner = difs(episodes=40, schedule="paper", quantile=0.3)
    learner.propose(40)
    learner.observe([episode(np.full((5, 2), i), float(i)) for i in range(1, 21)])
    assert learner._make_examples().z[:, 0, 0].tolist() == [1, 2, 3, 4, 5, 6]


def test_guidance_falls_while_more_fail_than_aimed_at_and_rises_again(episode):
    learner = difs(elite=4, target_rate=0.5, guidance=0.0)
    seen = []
    for failed in (0, 10, 0):
        for _ in range(3):
            count = len(learner.propose(10).sources)
            learner.observe(
                [episode(np.ones((5, 2)), 0.0 if i < failed else 5.0) for i in range(count)]
            )
        seen.append(learner._facts.guidance)
    assert seen[0] == 0.0
    assert seen[1] < 0.0
    assert seen[1] < seen[2]


def trained(episode, **settings):
    learner = difs(initial_share=0.1, **settings)
    learner.propose(100)
    learner.observe([episode(np.ones((5, 2)), float(i)) for i in range(10)])
    return learner


def test_exploit_draws_anew_at_every_call_and_goes_on_after_a_restore(episode):
    learner = trained(episode)
    first = noise(learner.exploit(6))
    restored = difs(initial_share=0.1)
    restored.restore(learner.state())
    again, other = noise(learner.exploit(6)), noise(restored.exploit(6))
    assert first.shape == (6, 5, 2)
    assert not np.array_equal(first, again)
    np.testing.assert_array_equal(again, other)


def test_exploit_teaches_nothing(episode):
    used, unused = trained(episode), trained(episode)
    for _ in range(3):
        used.exploit(4)
    np.testing.assert_array_equal(noise(used.propose(20)), noise(unused.propose(20)))


def test_exploit_takes_the_final_guidance(episode):
    prior = trained(episode, final_guidance=0.0, guidance=2.0)
    strong = trained(episode, final_guidance=3.0, guidance=2.0)
    assert noise(strong.exploit(200)).mean() > 2.0 * noise(prior.exploit(200)).mean() > 0.5


def test_earlier_campaigns_stand_for_draws_from_the_prior():
    random = np.random.default_rng(0)
    z = random.standard_normal((30, 5, 2)).astype(np.float32) + 2.0
    steps, robustness = np.full(30, 5.0), random.uniform(1.0, 9.0, 30)
    some = difs(initial_share=0.4, experience=Experience(z[:10], steps[:10], robustness[:10]))
    assert len(some.propose(100).sources) == 30
    enough = difs(initial_share=0.3, experience=Experience(z, steps, robustness))
    proposal = enough.propose(25)
    assert noise(proposal).mean() > 0.5


def test_no_failure_ever_is_learnt_from_and_guidance_stays(episode):
    learner = difs(guidance=0.3)
    course(learner, episode, 100)
    assert learner._facts.guidance == 0.3
    assert np.isfinite(noise(learner.exploit(5))).all()
