"""AST starts anew, and wider, where it finds next to nothing."""

from itertools import groupby
from types import MappingProxyType

import numpy as np
import pytest

from eigenfail.functions import of_batch
from eigenfail.settings import read_settings
from eigenfail.testing.learner import Corridor, LearnerSuite, ToyEngine
from eigenfail.values.learning import LearnerContext
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.methods.ast.method import AdaptiveStressTesting, Attempt, RestartRule
from eigenfail_workers.functions import FunctionEngine

QUICK = {"warm_up": 20, "gradient_steps": 1, "batch_size": 8, "hidden": [8]}
SAFE, EASY = Corridor(steps=10, wall=100.0), Corridor(steps=10, wall=0.0)
BARREN, SOME = (False,) * 100, (False,) * 90 + (True,) * 10


class TestWithRestartsAndAMean(LearnerSuite):
    method = AdaptiveStressTesting
    settings = MappingProxyType({**QUICK, "patience": 100, "averaged": 3})
    budget = 300
    rounds = 22


def ast(episodes=500, seed=3, horizon=SAFE.steps, **settings):
    context = LearnerContext(seed, episodes, horizon, np.zeros((0, horizon, 2), np.float32))
    given = {**QUICK, "patience": 100, **settings}
    return AdaptiveStressTesting(
        context, read_settings(AdaptiveStressTesting.Settings, given, "settings")
    )


def amplitudes(learner, engine, episodes=500):
    """Amplitude of each round, with the number of successive rounds that had it."""
    rounds, seen = Rounds(learner, 0, episodes), []
    while opened := rounds.open():
        seen.append(float(opened[0].policy.amplitude))
        engine.add_policy(opened[0].policy)
        rounds.complete(list(engine.run(opened[0].tasks)))
    return [(value, len(list(of))) for value, of in groupby(seen)]


RULE = RestartRule(patience=200, amplitude=2.0, largest_amplitude=4.0, episodes=1000)


@pytest.mark.parametrize(
    ("first", "observed", "recent", "stuck"),
    [
        (0, 200, BARREN, True),
        (0, 199, BARREN, False),
        (0, 200, BARREN[:99], False),
        (0, 200, SOME, False),
        (0, 200, (*SOME[1:], False), False),
        (0, 200, (*SOME[1:-1], False, False), True),
        (610, 800, BARREN, False),
        (600, 800, BARREN, True),
        (600, 801, BARREN, False),
    ],
)
def test_an_attempt_is_given_up_after_its_patience_if_as_much_is_left(
    first, observed, recent, stuck
):
    assert RULE.is_stuck(Attempt(1, first), observed, observed, recent) is stuck


def test_episodes_that_are_proposed_already_are_not_left_to_the_next_attempt():
    assert RULE.is_stuck(Attempt(), 200, 800, BARREN)
    assert not RULE.is_stuck(Attempt(), 200, 801, BARREN)


def test_without_patience_no_attempt_is_given_up():
    rule = RestartRule(None, 2.0, 4.0, 1000)
    assert not rule.is_stuck(Attempt(), 500, 500, BARREN)


def test_the_amplitude_grows_by_half_within_its_bound():
    attempts = [Attempt()]
    for first in (210, 420, 630):
        attempts.append(RULE.start_next(attempts[-1], first, first))
    assert [one.widening for one in attempts] == [1.0, 1.5, 2.0, 2.0]
    assert [one.number for one in attempts] == [0, 1, 2, 3]
    beyond = RestartRule(200, 5.0, 4.0, 1000)
    assert beyond.start_next(Attempt(), 210, 210).widening == 1.0


def test_each_attempt_has_networks_of_its_own_seed():
    seeds = [Attempt(number).derive_seed(7) for number in range(4)]
    assert seeds[0] == 7
    assert len(set(seeds)) == 4
    assert seeds == [Attempt(number).derive_seed(7) for number in range(4)]


def test_a_campaign_without_a_failure_is_widened_until_too_few_episodes_are_left():
    # The round that is open at a restart still has the amplitude before.
    found = amplitudes(ast(), ToyEngine(SAFE))
    assert found == [(2.0, 11), (3.0, 11), (4.0, 28)]
    kept = amplitudes(ast(largest_amplitude=2.0), ToyEngine(SAFE))
    assert kept == amplitudes(ast(patience=None), ToyEngine(SAFE)) == [(2.0, 50)]


def test_a_campaign_that_finds_failures_goes_on():
    assert amplitudes(ast(), ToyEngine(EASY)) == [(2.0, 50)]


def test_failures_beyond_the_first_amplitude_are_found():
    beyond = of_batch(lambda z: np.maximum(2.8 - z[:, 0, 0], 0.0))
    engine = FunctionEngine(beyond, 1)
    assert not any(r.is_failure for r in run(ast(horizon=1, patience=None), engine))
    failed = np.flatnonzero([result.is_failure for result in run(ast(horizon=1), engine)])
    assert 110 <= failed[0] < 220


def run(learner, engine, episodes=500):
    return list(run_in_process(Rounds(learner, 0, episodes), engine))


def test_a_restart_begins_with_new_networks_and_an_empty_buffer():
    learner = ast()
    engine = ToyEngine(SAFE)
    first = learner.propose(1).policy
    run(learner, engine, 100)
    assert learner._trainer.arrays()["memory.added"] == 0
    again = learner.propose(10)
    assert again.policy.amplitude == 3.0
    assert not np.array_equal(again.policy.mean.weight, first.mean.weight)
    assert again.policy.version > first.version


def test_the_used_policy_is_the_mean_of_the_last_versions():
    plain, mean = (ast(patience=None, averaged=length) for length in (1, 1000))
    versions = {}
    rounds, engine = Rounds(plain, 0, 100), ToyEngine(EASY)
    while opened := rounds.open():
        policy = opened[0].policy
        engine.add_policy(policy)
        rounds.complete(list(engine.run(opened[0].tasks)))
        newest = plain.propose(1).policy
        versions[newest.version] = newest
    trained = [policy for version, policy in versions.items() if version]
    run(mean, ToyEngine(EASY), 100)
    used = mean.exploit(1).policy
    for name in ("mean", "log_std"):
        wanted = np.mean([getattr(one, name).weight for one in trained], axis=0)
        np.testing.assert_allclose(getattr(used, name).weight, wanted, atol=1e-6)
    assert not np.allclose(used.mean.weight, trained[-1].mean.weight, atol=1e-6)
    newest, last = plain.exploit(1).policy, trained[-1]
    np.testing.assert_array_equal(newest.mean.weight, last.mean.weight)


def test_a_restart_forgets_the_mean_of_the_attempt_before():
    learner = ast(averaged=5)
    run(learner, ToyEngine(SAFE), 100)
    used, present = learner.exploit(1).policy, learner.propose(1).policy
    np.testing.assert_array_equal(used.mean.weight, present.mean.weight)
