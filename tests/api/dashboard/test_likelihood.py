"""What log p is held against, by hand: the entropy of a normal distribution, and its peak."""

from math import log, pi

import numpy as np
import pytest
from msgspec.structs import replace

from eigenfail.errors import NoisePruned
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import Outcome
from eigenfail_api.dashboard.charts import find_reference, make_reference

SIGMA = (2.0, 0.5)
PEAK = -log(2.0 * pi * SIGMA[0] * SIGMA[1])


def noise(z):
    z = np.asarray(z, np.float32)
    return NoiseTrajectory(z, np.tile(np.float32(SIGMA), (len(z), 1)))


def test_typical_noise_is_one_nat_a_step_below_none():
    found = make_reference([noise([(3.0, 0.0), (0.0, -1.0)]), noise([(0.5, 0.5)])])
    assert found.failures == 2
    assert found.none == pytest.approx(PEAK)
    assert found.typical == pytest.approx(PEAK - 1.0)


def test_longer_episodes_weigh_more():
    wide = NoiseTrajectory(np.zeros((3, 2), np.float32), np.full((3, 2), np.e, np.float32))
    narrow = NoiseTrajectory(np.zeros((1, 2), np.float32), np.ones((1, 2), np.float32))
    expected = (3 * (-log(2.0 * pi) - 2.0) - log(2.0 * pi)) / 4
    assert make_reference([wide, narrow]).none == pytest.approx(expected, rel=1e-6)


def test_of_nothing_there_is_no_reference(store, campaign):
    assert make_reference([]) is None
    assert find_reference(store, campaign, []) is None


def test_a_campaign_tells_its_likelihood_with_unit_n_and_reference(look, campaign, deliver, result):
    bent = noise([(2.0, 0.0), (0.0, 2.0)])
    crash = replace(result(0, Outcome.COLLISION), noise=bent, steps=2)
    deliver(campaign, crash, result(1))
    # Two steps of z²/2 = 2 below the peak of −1.84; typical noise is 1 below.
    likelihood = "log p per step [nats] −3.84 of 1 failure −2.84 for typical noise of p(x)"
    assert likelihood in look(f"/campaigns/{campaign}")
    assert "log p −7.6758 nats log p per step −3.84 nats" in look(
        f"/campaigns/{campaign}/episodes/0"
    )


def test_where_noise_was_pruned_there_is_no_reference(store, campaign, monkeypatch):
    def pruned(*_):
        raise NoisePruned("Its noise was pruned.")

    monkeypatch.setattr(store.episodes, "finished", pruned)
    assert find_reference(store, campaign, [0]) is None


def test_the_noise_of_the_same_failures_is_read_once(store, campaign, deliver, result, monkeypatch):
    deliver(campaign, *(result(index, Outcome.COLLISION) for index in range(3)))
    read, finished = [], store.episodes.finished
    monkeypatch.setattr(
        store.episodes, "finished", lambda of, which: read.append(which) or finished(of, which)
    )
    first = find_reference(store, campaign, [0, 1])
    assert first.failures == 2
    assert find_reference(store, campaign, [0, 1]) == first
    assert len(read) == 1
    assert find_reference(store, campaign, [0, 1, 2]).failures == 3
    assert len(read) == 2
