"""DiFS learns, keeps to what is likely, and copes with odd data."""

import numpy as np
import pytest
import torch
from difs_learners import make_difs, noise_of

from eigenfail.errors import LearnerDiverged, ProtocolError
from eigenfail.values.episode import Outcome, PriorSource, TrajectorySource
from eigenfail.values.learning import Experience
from eigenfail_services.methods import archive
from eigenfail_services.methods.difs.settings import DifsSettings, make_plan


def course(learner, episode, episodes):
    """How many of each round are from the prior, and how many are samples."""
    rounds, left = [], episodes
    while left:
        sources = learner.propose(left).sources
        drawn = sum(isinstance(each, PriorSource) for each in sources)
        rounds.append((drawn, len(sources) - drawn))
        left -= len(sources)
        learner.observe([episode(np.zeros((5, 2)), 2.0 + i) for i in range(len(sources))])
    return rounds


def test_goes_from_the_prior_over_rounds_to_samples_at_robustness_zero(episode):
    learner = make_difs(initial_share=0.3, final_share=0.25, round_size=20)
    rounds = course(learner, episode, 100)
    assert rounds == [(30, 0), (4, 16), (4, 16), (1, 4), (0, 25)]


def test_the_threshold_is_the_newest_rounds_quantile_and_never_rises(episode):
    learner = make_difs(quantile=0.25)
    seen = []
    for robustness in ([8.0, 4.0, 6.0, 10.0, 12.0], [5.0, 3.0, 9.0], [9.0, 9.0], [0.0, 0.0]):
        learner.propose(10)
        learner.observe([episode(np.zeros((5, 2)), r) for r in robustness])
        seen.append(learner._facts.threshold_m)
    assert seen == pytest.approx([6.0, 4.0, 4.0, 0.0])
    assert learner._facts.scale_m == 8.0, "the median of those that did not fail"


@pytest.mark.parametrize("robustness", [0.0, 5.0])
def test_all_failures_or_constant_robustness_are_learnt_from(episode, robustness):
    learner = make_difs()
    for _ in range(3):
        sources = learner.propose(20).sources
        learner.observe([episode(np.zeros((5, 2)), robustness) for _ in sources])
    assert np.isfinite(noise_of(learner.propose(20))).all()


def test_a_weight_that_becomes_nan_ends_the_learner_with_a_remedy(episode):
    learner = make_difs(initial_share=0.1)
    learner.propose(10)
    with torch.no_grad():
        learner._model._denoiser.first.weight[0] = float("nan")
    with pytest.raises(LearnerDiverged, match=r"diverged.*Lower learning_rate"):
        learner.observe([episode(np.zeros((5, 2)), 1.0)])


def test_samples_that_are_not_finite_never_leave_the_learner(episode):
    learner = make_difs()
    with torch.no_grad():
        learner._model._average.trend.last.bias[0] = float("inf")
    with pytest.raises(LearnerDiverged, match=r"not finite.*Lower"):
        learner.exploit(3)


def test_a_state_of_another_horizon_is_refused():
    with pytest.raises(ProtocolError, match="should have shape"):
        make_difs(horizon=5).restore(make_difs(horizon=6).state())


def test_a_state_with_the_weights_of_another_network_is_refused():
    learner = make_difs()
    facts, arrays = archive.read("difs", learner.state(), learner._Facts)
    with pytest.raises(ProtocolError, match=r"'denoiser\.first\.weight' should have shape"):
        make_difs(width=8).restore(archive.write("difs", facts, arrays))


@pytest.mark.parametrize("robustness", [0.0, -9.0])
def test_a_threshold_at_failures_asks_for_samples_at_robustness_zero(episode, robustness):
    learner = make_difs(initial_share=0.1)
    learner.propose(10)
    learner.observe([episode(np.full((5, 2), i), robustness) for i in range(10)])
    assert len(learner.propose(5).sources) == 5
    assert learner._draw_conditions(5).tolist() == [0.0] * 5


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
    rounds = course(make_difs(episodes, schedule="paper"), episode, episodes)
    assert rounds == [(sizes[0], 0), *((0, size) for size in sizes[1:])]


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


def test_earlier_campaigns_stand_for_draws_from_the_prior():
    random = np.random.default_rng(0)
    z = random.standard_normal((30, 5, 2)).astype(np.float32) + 2.0
    steps, robustness = np.full(30, 5.0), random.uniform(1.0, 9.0, 30)
    some = make_difs(initial_share=0.4, experience=Experience(z[:10], steps[:10], robustness[:10]))
    assert len(some.propose(100).sources) == 30
    enough = make_difs(initial_share=0.3, experience=Experience(z, steps, robustness))
    sources = enough.propose(25).sources
    assert {type(each) for each in sources} == {PriorSource, TrajectorySource}
    assert enough._model.trained


def test_no_failure_ever_is_learnt_from(episode):
    learner = make_difs()
    course(learner, episode, 100)
    assert learner._model.trained
    assert np.isfinite(noise_of(learner.exploit(5))).all()


def test_without_any_result_a_campaign_goes_on_with_draws_from_the_prior(episode):
    learner = make_difs(round_size=20)
    for _ in range(3):
        sources = learner.propose(100).sources
        assert sources == (PriorSource(),) * 20
        learner.observe([episode(np.zeros((5, 2)), outcome=Outcome.ERRORED) for _ in sources])
    assert len(learner.exploit(3).sources) == 3


class Watched:
    """A model that keeps what it is trained on and asked for."""

    def __init__(self, learner):
        self.trained, self.examples, self.steps, self.share, self.asked = False, None, [], None, []
        learner._model = self

    def train(self, examples, steps, elite_share, draw):
        self.trained, self.examples, self.share = True, examples, elite_share
        self.steps.append(steps)

    def sample(self, condition, excess, draw):
        self.asked.append((condition, excess))
        return np.zeros((len(condition), *self.examples.z.shape[1:]), np.float32)


def watch_a_round(episode, **settings):
    """Return the model after 40 episodes, ten of which fail, and a proposal of 20."""
    learner = make_difs(episodes=60, initial_share=2 / 3, round_size=20, **settings)
    model = Watched(learner)
    learner.propose(60)
    robustness = [0.0] * 10 + [float(i) for i in range(1, 31)]
    learner.observe([episode(np.full((5, 2), 0.5 if r else 2.0), r) for r in robustness])
    learner.propose(20)
    return model


def test_failures_have_the_condition_zero_and_all_others_their_robustness(episode):
    condition = watch_a_round(episode).examples.condition
    assert condition[:10].tolist() == [0.0] * 10
    np.testing.assert_allclose(condition[10:], np.arange(1, 31) / 15.5)


def test_the_paper_trains_on_the_elite_alone_and_knows_robustness_alone(episode):
    model = watch_a_round(episode, schedule="paper", first_steps=7)
    assert (model.share, model.steps) == (1.0, [7])
    # Below the quantile of 0.3, but twenty at least.
    assert np.flatnonzero(model.examples.weights).tolist() == list(range(20))
    assert not model.examples.excess.any()
    ((conditions, excess),) = model.asked
    assert len(conditions) == 20
    assert excess == 0.0


def test_many_rounds_train_on_all_and_ask_for_the_median_excess_of_the_first_elite(episode):
    model = watch_a_round(episode)
    assert model.share == 0.5
    assert len(model.examples.z) == 40
    ((conditions, excess),) = model.asked
    assert len(conditions) == 16, "a fifth of a round is from p(x)"
    elite = model.examples.excess[model.examples.weights > 0.0]
    assert excess == pytest.approx(np.median(elite))
    weights = model.examples.weights[model.examples.weights > 0.0]
    assert weights.max() / weights.min() == pytest.approx(np.exp(4.0)), "the likeliest weighs most"


def test_settings_replace_what_a_schedule_says(episode):
    given = {"prior_share": 0.5, "target_rate": 0.2}
    ((conditions, excess),) = watch_a_round(episode, schedule="paper", **given).asked
    assert len(conditions) == 10
    assert excess > 0.0


@pytest.mark.parametrize(("failed", "asked"), [(0, 2.0), (4, 1.0), (8, 0.5), (10, 0.25 * 2**0.5)])
def test_samples_are_asked_for_less_excess_the_more_of_them_failed(episode, failed, asked):
    """A round of 20: four draws from p(x), eleven samples, five moved ones."""
    learner = make_difs(episodes=100, initial_share=0.4, round_size=20, target_rate=4 / 11)
    model = Watched(learner)
    learner.propose(100)
    learner.observe([episode(np.zeros((5, 2)), float(i)) for i in range(1, 41)])
    learner.propose(20)
    robustness = [5.0] * 4 + [0.0] * failed + [5.0] * (11 - failed) + [0.0] * 5
    learner.observe([episode(np.full((5, 2), 2.0), each) for each in robustness])
    learner.propose(20)
    assert [excess for _, excess in model.asked] == [1.0, pytest.approx(asked)]


def test_samples_are_asked_for_no_more_excess_than_most_failures_have(episode):
    learner = make_difs(episodes=100, initial_share=0.4, round_size=20)
    model = Watched(learner)
    learner.propose(100)
    learner.observe([episode(np.full((5, 2), 1.5), float(max(0, i))) for i in range(-4, 36)])
    learner.propose(20)
    assert model.asked[0][1] == pytest.approx((10 * 1.5**2 - 10) / 20**0.5)
    learner.observe([episode(np.full((5, 2), 3.0), 5.0)] * 20)
    learner.propose(20)
    assert model.asked[1][1] == model.asked[0][1], "no sample failed, but the failures are known"


@pytest.mark.parametrize(("horizon", "most"), [(5, 30.0), (1000, 3.0 * 1000**0.5)])
def test_a_search_without_failures_asks_for_so_much_excess_at_most(episode, horizon, most):
    learner = make_difs(horizon=horizon, episodes=300, initial_share=0.1, round_size=20)
    model = Watched(learner)
    learner.propose(30)
    learner.observe([episode(np.zeros((horizon, 2)), 2.0 + i) for i in range(30)])
    for _ in range(10):
        learner.propose(20)
        learner.observe([episode(np.zeros((horizon, 2)), 2.0)] * 20)
    assert max(excess for _, excess in model.asked) == pytest.approx(most)


def test_the_last_part_is_sampled_from_one_model(episode):
    learner = make_difs(episodes=60, initial_share=1 / 3, round_size=20, final_share=1 / 3)
    model = Watched(learner)
    course(learner, episode, 60)
    assert len(model.steps) == 2
    assert not model.asked[-1][0].any()


@pytest.mark.parametrize(
    ("settings", "episodes", "wanted"),
    [
        ({}, 1000, (67, 67, 1000)),
        ({}, 100, (25, 25, 100)),
        ({"round_size": 500}, 400, (400, 500, 400)),
        ({"initial_share": 1.0}, 400, (400, 40, 400)),
        ({"initial_share": 0.5, "final_share": 0.75}, 400, (200, 40, 200)),
        ({"final_share": 1.0}, 400, (40, 40, 40)),
        ({"schedule": "paper"}, 2000, (500, 500, 1000)),
        ({"schedule": "paper", "initial_share": 0.6}, 2000, (1200, 500, 1200)),
    ],
)
def test_a_plan_has_draws_from_the_prior_then_rounds_then_the_last_part(settings, episodes, wanted):
    plan = make_plan(episodes, DifsSettings(**settings))
    assert (plan.initial, plan.round_size, plan.final) == wanted


def test_a_campaign_whose_last_part_follows_the_prior_learns_from_the_prior(episode):
    learner = make_difs(initial_share=0.5, final_share=1.0)
    assert course(learner, episode, 100) == [(50, 0), (0, 50)]


def test_results_that_come_after_the_planned_rounds_are_learnt_from(episode):
    learner = make_difs(initial_share=0.2, round_size=20, final_share=0.5)
    for outcome in (Outcome.ERRORED, Outcome.ERRORED, Outcome.ERRORED, Outcome.SAFE):
        sources = learner.propose(20).sources
        assert sources == (PriorSource(),) * 20
        learner.observe([episode(np.ones((5, 2)), 1.0, outcome=outcome) for _ in sources])
    assert len(noise_of(learner.propose(20))) == 20


def test_a_last_part_that_does_not_fit_one_message_is_divided(episode, monkeypatch):
    monkeypatch.setattr("eigenfail_services.methods.batch_learner.MAX_VALUES_PER_ROUND", 200)
    learner = make_difs(initial_share=0.2, round_size=20, final_share=0.6)
    assert course(learner, episode, 100) == [(20, 0), (4, 16), (0, 21), (0, 21), (0, 18)]


def test_earlier_campaigns_without_a_measured_episode_change_nothing(episode):
    nothing = Experience(np.zeros((0, 5, 2), np.float32), np.zeros(0), np.zeros(0))
    learner = make_difs(experience=nothing)
    assert learner.propose(100).sources == (PriorSource(),) * 25
    learner.observe([episode(np.ones((5, 2)), 4.0 + i) for i in range(25)])
    assert learner._facts.scale_m == 16.0
