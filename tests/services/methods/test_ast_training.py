"""AST stops once it has converged, is used without learning, and starts from what it knew."""

from types import MappingProxyType

import msgspec
import numpy as np
import pytest

from eigenfail.errors import InvalidValue, LearnerDiverged
from eigenfail.settings import read_settings
from eigenfail.testing.learner import Corridor, LearnerSuite, ToyEngine
from eigenfail.values.episode import PolicySource
from eigenfail.values.learning import LearnerContext, Predecessor
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.methods.ast.method import AdaptiveStressTesting

EASY, HARD = Corridor(wall=0.0), Corridor()
QUICK = {"round_size": 10, "warm_up": 20, "gradient_steps": 1, "batch_size": 8}


class TestWithDissimilarity(LearnerSuite):
    method = AdaptiveStressTesting
    settings = MappingProxyType(
        {
            "round_size": 4,
            "warm_up": 4,
            "gradient_steps": 1,
            "reward": "dissimilarity",
            "hold": 5,
            "n_step": 3,
        }
    )


class TestOnceConverged(LearnerSuite):
    method = AdaptiveStressTesting
    settings = MappingProxyType({"round_size": 10, "warm_up": 10, "converged_share": 0.01})
    budget = 200
    rounds = 12


def ast(episodes=400, seed=0, predecessors=(), **settings):
    nothing = np.zeros((0, HARD.steps, 2), np.float32)
    context = LearnerContext(seed, episodes, HARD.steps, nothing, predecessors)
    given = read_settings(AdaptiveStressTesting.Settings, {**QUICK, **settings}, "settings")
    return AdaptiveStressTesting(context, given)


def run(learner, episodes, corridor=HARD, seed=0):
    return list(run_in_process(Rounds(learner, seed, episodes), ToyEngine(corridor)))


def same(first, second):
    return all(
        np.array_equal(a.weight, b.weight) and np.array_equal(a.bias, b.bias)
        for a, b in zip(
            (*first.hidden, first.mean, first.log_std),
            (*second.hidden, second.mean, second.log_std),
            strict=True,
        )
    )


def test_training_ends_with_the_round_that_makes_it_a_hundred_episodes_of_enough_failures():
    learner = ast(converged_share=0.5)
    failures = np.array([result.is_failure for result in run(learner, 300, EASY)])
    ends = [n for n in range(100, 301, 10) if failures[n - 100 : n].mean() >= 0.5]
    assert learner.trained_episodes == ends[0] - 10 < 290, "the last round ends training untrained"
    policy = learner.propose(1).policy
    assert policy.version == (ends[0] - 20) // 10
    run(learner, 20, EASY)
    assert same(learner.propose(1).policy, policy)
    assert learner.trained_episodes == ends[0] - 10


@pytest.mark.parametrize(("share", "corridor"), [(1.0, Corridor(wall=5.0)), (None, EASY)])
def test_training_goes_on_where_it_does_not_converge(share, corridor):
    learner = ast(converged_share=share, patience=None)
    run(learner, 150, corridor)
    assert learner.trained_episodes == 150
    assert learner.propose(1).policy.version == 14


def test_convergence_outlasts_a_restart():
    learner = ast(converged_share=0.5)
    run(learner, 300, EASY)
    again = ast(seed=5)
    again.restore(learner.state())
    assert again.trained_episodes == learner.trained_episodes < 300
    run(again, 20, EASY)
    assert again.trained_episodes == learner.trained_episodes


def test_an_action_is_stored_by_the_amplitude_under_which_it_was_chosen():
    learner = ast(episodes=80, amplitude=3.0, warm_up=60)
    results = run(learner, 20)
    stored = learner._trainer.arrays()["memory.actions"]
    chosen = np.concatenate([result.noise.z[::10] for result in results])
    np.testing.assert_allclose(stored, chosen / 3.0, rtol=1e-5)


def test_exploiting_without_a_mean_uses_the_newest_policy_and_changes_nothing():
    learner = ast(amplitude=3.0, averaged=1)
    run(learner, 40)
    before = learner.state()
    used = learner.exploit(7)
    assert learner.state() == before
    assert used.sources == (PolicySource(used.policy.version),) * 7
    assert used.policy.amplitude == 3.0
    assert same(used.policy, learner.propose(1).policy)


def test_a_state_without_a_mean_is_used_by_its_newest_policy():
    """Campaigns that ran when the last policy was the default have such a state."""
    learner = ast(averaged=1)
    run(learner, 60)
    again = ast()
    again.restore(learner.state())
    assert same(again.exploit(1).policy, learner.exploit(1).policy)
    run(again, 40)
    assert not same(again.exploit(1).policy, again.propose(1).policy)


def predecessor(learner, **settings):
    given = {**QUICK, **settings}
    return Predecessor(12, "ast", given, 0, 400, HARD.steps, learner.state())


def test_a_warm_start_begins_with_the_earlier_policy():
    before = ast()
    run(before, 60)
    cold = ast(seed=9)
    warm = ast(seed=9, predecessors=(predecessor(before),), warm_start=12)
    earlier = before.propose(1).policy
    assert same(warm.propose(1).policy, earlier)
    assert not same(cold.propose(1).policy, earlier)
    assert warm.trained_episodes == 0
    assert warm.propose(1).policy.version == 0


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"warm_start": 13}, "not at hand"),
        ({"warm_start": 12, "hidden": [8]}, "do not fit.*Use that campaign's `hidden`"),
        ({"warm_start": 12, "trainer": "sb3"}, "do not fit"),
    ],
)
def test_a_warm_start_that_does_not_fit_is_refused(changes, why):
    with pytest.raises(InvalidValue, match=rf"settings\.warm_start: .*{why}"):
        ast(predecessors=(predecessor(ast()),), **changes)


@pytest.mark.fault("NaN or infinity in a learner")
@pytest.mark.parametrize("part", ["actor", "critics", "targets"])
def test_a_nan_ends_the_learner_before_a_policy_could_carry_it(part):
    learner = ast(warm_up=0)
    results = run(ast(), 10)
    learner.observe(results)
    sound = learner.state()
    getattr(learner._trainer, part).weights[5] = np.nan
    with pytest.raises(LearnerDiverged, match=r"diverged.*Lower learning_rate"):
        learner.observe(results)
    again = ast(warm_up=0)
    again.restore(sound)
    weights = msgspec.structs.astuple(again.propose(1).policy.mean)
    assert all(np.isfinite(weight).all() for weight in weights)
