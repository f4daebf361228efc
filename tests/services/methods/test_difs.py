"""DiFS learns, keeps to what is likely, and copes with odd data."""

import numpy as np
import pytest
import torch
from difs_learners import make_difs, noise_of

from eigenfail.errors import LearnerDiverged, ProtocolError
from eigenfail.values.episode import PriorSource, TrajectorySource
from eigenfail.values.learning import Experience
from eigenfail_services.methods import archive


def course(learner, episode, episodes):
    """The kinds and sizes of the rounds, each episode of another robustness."""
    kinds, left = [], episodes
    while left:
        sources = learner.propose(left).sources
        kinds.append((type(sources[0]), len(sources)))
        left -= len(sources)
        learner.observe([episode(np.zeros((5, 2)), 2.0 + i) for i in range(len(sources))])
    return kinds


def test_goes_from_the_prior_over_rounds_to_samples_at_robustness_zero(episode):
    learner = make_difs(initial_share=0.3, final_share=0.25, round_size=20)
    kinds = course(learner, episode, 100)
    prior, sampled = PriorSource, TrajectorySource
    assert kinds == [(prior, 30), (sampled, 20), (sampled, 20), (sampled, 5), (sampled, 25)]


def test_the_threshold_is_the_newest_rounds_quantile_and_never_rises(episode):
    learner = make_difs(quantile=0.25)
    seen = []
    for robustness in ([8.0, 4.0, 6.0, 10.0, 12.0], [5.0, 3.0, 9.0], [9.0, 9.0], [0.0, 0.0]):
        learner.propose(10)
        learner.observe([episode(np.zeros((5, 2)), r) for r in robustness])
        seen.append(learner._facts.threshold_m)
    assert seen == pytest.approx([6.0, 4.0, 4.0, 0.0])
    assert learner._facts.scale_m == 8.0


@pytest.mark.parametrize("robustness", [0.0, 5.0])
def test_all_failures_or_constant_robustness_are_learnt_from(episode, robustness):
    learner = make_difs()
    for _ in range(3):
        sources = learner.propose(20).sources
        learner.observe([episode(np.zeros((5, 2)), robustness) for _ in sources])
    for source in learner.propose(20).sources:
        assert np.isfinite(source.z).all()


def test_a_weight_that_becomes_nan_ends_the_learner_with_a_remedy(episode):
    learner = make_difs()
    learner.propose(10)
    with torch.no_grad():
        learner._model._average.first.weight[0] = float("nan")
    with pytest.raises(LearnerDiverged, match=r"diverged.*Lower learning_rate"):
        learner.observe([episode(np.zeros((5, 2)), 1.0)])


def test_samples_that_are_not_finite_never_leave_the_learner(episode):
    learner = make_difs()
    learner._model.mixture.means[0, 0] = np.inf
    with pytest.raises(LearnerDiverged, match=r"not finite.*Lower"):
        learner.exploit(3)


def test_a_state_of_another_horizon_is_refused():
    with pytest.raises(ProtocolError, match="should have shape"):
        make_difs(horizon=5).restore(make_difs(horizon=6).state())


def test_a_state_with_the_weights_of_another_network_is_refused():
    learner = make_difs()
    facts, arrays = archive.read("difs", learner.state(), learner._Facts)
    renamed = {name.replace(".first.", ".correction.0."): a for name, a in arrays.items()}
    with pytest.raises(ProtocolError, match=r"'denoiser\.first\.weight' should have shape"):
        learner.restore(archive.write("difs", facts, renamed))


def test_the_network_also_learns_from_near_failures_and_failures_have_the_condition_zero(episode):
    learner = make_difs(episodes=40, elite=2, replay=0.5)
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
    learner = make_difs(episodes=40, elite=4, schedule=schedule)
    learner.propose(20)
    learner.observe([episode(np.full((5, 2), i), 1.0 + i) for i in range(10)])
    assert learner._model.trained == trained
    learner.propose(20)
    learner.observe([episode(np.full((5, 2), i), 0.0) for i in range(10)])
    assert learner._model.trained


def test_a_threshold_far_beyond_failures_asks_for_samples_at_robustness_zero(episode):
    learner = make_difs(initial_share=0.1)
    learner.propose(10)
    learner.observe([episode(np.full((5, 2), i), -9.0) for i in range(10)])
    assert len(learner.propose(5).sources) == 5
    assert learner._draw_conditions(5).tolist() == [0.0] * 5


def test_no_gradient_step_leaves_the_mixture_alone(episode):
    learner = trained(episode, first_steps=0, steps=0)
    assert float(learner._model._average.trust) == 0.0
    assert noise_of(learner.exploit(400)).mean() > 0.5


def test_proposals_do_not_depend_on_what_else_draws_from_torch(episode):
    def proposed(disturb):
        learner = make_difs(initial_share=0.1)
        learner.propose(100)
        disturb()
        learner.observe([episode(np.ones((5, 2)), float(i)) for i in range(10)])
        disturb()
        return noise_of(learner.propose(90))

    before = torch.random.get_rng_state()
    np.testing.assert_array_equal(proposed(lambda: None), proposed(lambda: torch.rand(3)))
    torch.random.set_rng_state(before)


@pytest.mark.parametrize(
    ("episodes", "sizes"), [(1500, [500, 500, 500]), (61, [31, 30])], ids=["paper", "smaller"]
)
def test_the_papers_preset_samples_below_the_threshold_and_then_at_zero(episode, episodes, sizes):
    """500 from the prior, 500 below the threshold, 500 at zero; a smaller budget is two halves."""
    kinds = course(make_difs(episodes, schedule="paper"), episode, episodes)
    assert [size for _, size in kinds] == sizes
    assert [kind for kind, _ in kinds] == [PriorSource, *[TrajectorySource] * (len(sizes) - 1)]


def test_the_papers_preset_trains_on_all_below_the_threshold(episode):
    learner = make_difs(episodes=40, schedule="paper", quantile=0.3)
    learner.propose(40)
    learner.observe([episode(np.full((5, 2), i), float(i)) for i in range(1, 21)])
    assert learner._make_examples().z[:, 0, 0].tolist() == [1, 2, 3, 4, 5, 6]


def test_guidance_falls_while_more_fail_than_aimed_at_and_rises_again(episode):
    learner = make_difs(elite=4, target_rate=0.5, guidance=0.0)
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
    learner = make_difs(initial_share=0.1, **settings)
    learner.propose(100)
    learner.observe([episode(np.ones((5, 2)), float(i)) for i in range(10)])
    return learner


def test_exploit_draws_anew_at_every_call_and_goes_on_after_a_restore(episode):
    learner = trained(episode)
    first = noise_of(learner.exploit(6))
    restored = make_difs(initial_share=0.1)
    restored.restore(learner.state())
    again, other = noise_of(learner.exploit(6)), noise_of(restored.exploit(6))
    assert first.shape == (6, 5, 2)
    assert not np.array_equal(first, again)
    np.testing.assert_array_equal(again, other)


def test_exploit_teaches_nothing(episode):
    used, unused = trained(episode), trained(episode)
    for _ in range(3):
        used.exploit(4)
    np.testing.assert_array_equal(noise_of(used.propose(20)), noise_of(unused.propose(20)))


def test_exploit_takes_the_final_guidance(episode):
    prior = trained(episode, final_guidance=0.0, guidance=2.0)
    strong = trained(episode, final_guidance=3.0, guidance=2.0)
    assert noise_of(strong.exploit(200)).mean() > 2.0 * noise_of(prior.exploit(200)).mean() > 0.5


def test_earlier_campaigns_stand_for_draws_from_the_prior():
    random = np.random.default_rng(0)
    z = random.standard_normal((30, 5, 2)).astype(np.float32) + 2.0
    steps, robustness = np.full(30, 5.0), random.uniform(1.0, 9.0, 30)
    some = make_difs(initial_share=0.4, experience=Experience(z[:10], steps[:10], robustness[:10]))
    assert len(some.propose(100).sources) == 30
    enough = make_difs(initial_share=0.3, experience=Experience(z, steps, robustness))
    proposal = enough.propose(25)
    assert noise_of(proposal).mean() > 0.5


def test_no_failure_ever_is_learnt_from_and_guidance_stays(episode):
    learner = make_difs(guidance=0.3)
    course(learner, episode, 100)
    assert learner._facts.guidance == 0.3
    assert np.isfinite(noise_of(learner.exploit(5))).all()
