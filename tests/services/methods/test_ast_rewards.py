"""The named rewards, worked by hand."""

from math import log, sqrt

import numpy as np
import pytest

from eigenfail.settings import read_settings
from eigenfail.values.learning import LearnerContext
from eigenfail_services.methods.ast.method import make_reward
from eigenfail_services.methods.ast.settings import AstSettings

CONTEXT = LearnerContext(0, 10, 4, np.zeros((0, 4, 2), np.float32))
Z = [(0, 0), (3, 4), (0, -1), (2, 0)]


def reward(name, **settings):
    given = {"reward": name, "alpha": 5000.0, "c_dist": 1000.0, **settings}
    return make_reward(read_settings(AstSettings, given, "settings"), CONTEXT)


@pytest.mark.parametrize("name", ["paper", "mahalanobis", "dissimilarity"])
def test_every_reward_ends_as_the_papers_does(episode, name):
    assert reward(name)(episode(Z))[-1] == 0.0
    assert reward(name)(episode(Z, robustness_m=2.5))[-1] == -7500.0


def test_mahalanobis_is_the_logarithm_of_the_distance_from_the_mean(episode):
    found = reward("mahalanobis")(episode(Z))
    assert found[:3] == pytest.approx([0.0, -log(6.0), -log(2.0)])


@pytest.mark.parametrize("name", ["paper", "mahalanobis"])
def test_what_was_found_changes_only_the_reward_that_compares(episode, name):
    before = reward(name)
    assert before.update([episode(Z)]) is before
    assert before.arrays() == {}


def test_a_failure_earns_its_distance_from_the_nearest_failure_known(episode):
    fresh = reward("dissimilarity", c_dissimilarity=10.0)
    far, near = np.zeros((4, 2)), np.array([(0, 0), (3, 4), (0, -1), (0, 0)])
    seen = fresh.update([episode(far), episode(near), episode(Z, robustness_m=1.0)])
    assert len(seen.failures) == 2
    paper = reward("paper")(episode(Z))
    found = seen(episode(Z))
    assert found[:-1] == pytest.approx(paper[:-1])
    assert found[-1] == pytest.approx(10.0 * sqrt(2.0**2 / 8))


def test_behind_an_episodes_end_there_is_no_noise(episode):
    seen = reward("dissimilarity").update([episode(Z)])
    assert seen.measure_distance(episode(Z[:3])) == pytest.approx(sqrt(2.0**2 / 8))


def test_a_failure_like_one_before_earns_nothing(episode):
    seen = reward("dissimilarity").update([episode(Z)])
    assert seen(episode(Z))[-1] == 0.0


def test_the_newest_hundred_failures_are_kept_and_come_back(episode):
    fresh = reward("dissimilarity")
    seen = fresh.update([episode(np.full((4, 2), i)) for i in range(130)])
    assert seen.failures[:, 0, 0].tolist() == list(range(30, 130))
    again = fresh.load(seen.arrays())
    np.testing.assert_array_equal(again.failures, seen.failures)
    with pytest.raises(ValueError, match="no failures"):
        fresh.load({})
