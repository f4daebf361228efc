"""The reward and the decision process, worked by hand."""

from math import log, pi

import numpy as np
import pytest

from eigenfail.errors import LearnerFailed
from eigenfail.values.episode import Outcome
from eigenfail.values.measures import Measures
from eigenfail_services.methods.ast.decisions import (
    DecisionProcess,
    PaperReward,
    is_usable,
    make_decisions,
)

REWARD = PaperReward(alpha=5000.0, c_dist=1000.0)

AT_ZERO = -log(2.0) - log(0.5) - log(2.0 * pi)
"""log p of no noise, with sigma (2, 0.5): about -1.838."""


def test_steps_before_the_end_earn_their_log_probability(episode):
    rewards = REWARD(episode([(0, 0), (1, 0), (0, 2), (3, 3)], robustness_m=7.0))
    np.testing.assert_allclose(rewards[:3], [AT_ZERO, AT_ZERO - 0.5, AT_ZERO - 2.0], rtol=1e-6)


def test_a_terminal_failure_earns_nothing(episode):
    assert REWARD(episode([(0, 0), (3, 3)]))[-1] == 0.0


def test_any_other_end_is_penalised_by_the_distance_left(episode):
    assert REWARD(episode([(0, 0), (3, 3)], robustness_m=7.25))[-1] == -5000.0 - 7250.0


def test_a_held_decision_earns_the_sum_over_its_steps(episode):
    z = np.repeat([(1.5, 0.0), (0.0, -3.0), (3.0, 0.0)], [2, 2, 1], axis=0)
    found = make_decisions(episode(z, robustness_m=2.0), REWARD, DecisionProcess(hold=2), 3.0)
    np.testing.assert_allclose(
        found.rewards, [2 * (AT_ZERO - 1.125), 2 * (AT_ZERO - 4.5), -7000.0], rtol=1e-6
    )
    np.testing.assert_array_equal(found.actions, np.float32([(0.5, 0), (0, -1), (1, 0)]))
    np.testing.assert_array_equal(found.states[:, 0], [0, 2, 4])
    np.testing.assert_array_equal(found.next_states[:, 0], [2, 4, 4])
    np.testing.assert_array_equal(found.ends, [0, 0, 1])


def test_the_last_decision_earns_its_earlier_steps_and_the_end(episode):
    found = make_decisions(episode(np.zeros((4, 2))), REWARD, DecisionProcess(hold=3), 3.0)
    np.testing.assert_allclose(found.rewards, [3 * AT_ZERO, 0.0], rtol=1e-6)
    found = make_decisions(episode(np.zeros((6, 2))), REWARD, DecisionProcess(hold=3), 3.0)
    np.testing.assert_allclose(found.rewards, [3 * AT_ZERO, 2 * AT_ZERO], rtol=1e-6)


def test_rewards_of_several_decisions_are_summed_until_the_end(episode):
    z = np.array([(0, 0), (1, 0), (0, 2), (3, 0), (0, 0)])
    process = DecisionProcess(hold=1, n_step=3, gamma=0.5)
    found = make_decisions(episode(z, robustness_m=2.0), REWARD, process, amplitude=3.0)
    r = AT_ZERO - np.array([0.0, 0.5, 2.0, 4.5])
    expected = [
        r[0] + 0.5 * r[1] + 0.25 * r[2],
        r[1] + 0.5 * r[2] + 0.25 * r[3],
        r[2] + 0.5 * r[3] + 0.25 * -7000.0,
        r[3] + 0.5 * -7000.0,
        -7000.0,
    ]
    np.testing.assert_allclose(found.rewards, expected, rtol=1e-6)
    np.testing.assert_array_equal(found.next_states[:, 0], [3, 4, 4, 4, 4])
    np.testing.assert_array_equal(found.ends, [0, 0, 1, 1, 1])


def test_more_steps_than_decisions_give_the_return_of_the_episode(episode):
    process = DecisionProcess(hold=2, n_step=50)
    found = make_decisions(episode(np.zeros((5, 2))), REWARD, process, amplitude=3.0)
    np.testing.assert_allclose(found.rewards, [4 * AT_ZERO, 2 * AT_ZERO, 0.0], rtol=1e-6)
    np.testing.assert_array_equal(found.ends, [1, 1, 1])


def test_what_was_not_run_to_its_end_is_not_usable(episode):
    assert is_usable(episode([(0, 0)]))
    assert not is_usable(episode([(0, 0)], outcome=Outcome.ERRORED))
    assert not is_usable(episode([]))
    assert not is_usable(episode([(0, 0)], states=None))


@pytest.mark.parametrize("where", ["robustness", "noise", "state"])
def test_a_nan_is_refused_with_the_episode_that_holds_it(episode, where):
    nan = float("nan")
    result = {
        "robustness": lambda: episode([(0, 0)], 1.0, index=17, measures=Measures(nan)),
        "noise": lambda: episode([(nan, 0)], 1.0, index=17),
        "state": lambda: episode([(0, 0)], 1.0, index=17, states=np.full((1, 6), nan)),
    }[where]()
    with pytest.raises(LearnerFailed, match=r"Episode 17 has a NaN"):
        make_decisions(result, REWARD, DecisionProcess(hold=5), 3.0)
