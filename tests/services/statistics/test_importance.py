"""Weighted sums: by hand, and where numbers would overflow."""

from math import sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail_services.statistics.importance import (
    FEWEST_EFFECTIVE,
    NO_ROUND,
    NOT_YET,
    WeightedFailures,
    explain_nothing_counted,
)

LOGS = st.lists(st.floats(-30.0, 5.0), max_size=20)


def test_an_estimate_by_hand():
    """200 failures of weight 0.01 and 100 of weight 0.02 in 1000 episodes."""
    logs = np.log([0.01] * 200 + [0.02] * 100)
    found = WeightedFailures().after(logs, 1000).estimate()
    effective = 4.0**2 / (200 * 0.01**2 + 100 * 0.02**2)
    assert found.probability == pytest.approx(0.004)
    assert found.effective == pytest.approx(effective)
    assert found.cv == pytest.approx(sqrt(1.0 / effective - 1.0 / 1000))


@given(st.lists(LOGS, max_size=5))
def test_rounds_add_up(rounds):
    sums = WeightedFailures()
    for logs in rounds:
        sums = sums.after(np.array(logs), 20)
    weights = np.exp([one for logs in rounds for one in logs])
    assert sums.episodes == 20 * len(rounds)
    assert sums.failures == len(weights)
    assert np.exp(sums.log_first) == pytest.approx(weights.sum())
    assert 0.0 <= sums.effective() <= len(weights) * (1.0 + 1e-9)


@pytest.mark.parametrize("size", [-5000.0, 0.0, 5000.0])
def test_no_weight_is_too_large_or_small(size):
    found = WeightedFailures().after(np.full(200, size), 200).estimate()
    assert found.effective == pytest.approx(200.0)
    assert found.probability == (0.0 if size < 0.0 else 1.0)
    assert np.isfinite(found.cv)


def test_one_weight_that_outweighs_all_others_is_refused():
    logs = np.array([0.0] + [-50.0] * 999)
    found = WeightedFailures().after(logs, 1000).estimate()
    assert found.effective == pytest.approx(1.0)
    assert found.probability is found.interval is found.cv is None
    assert "The failures (1000) are worth 1.0 by their weights, and it takes 100" in found.problem


def test_a_running_campaign_waits_and_one_that_is_over_needs_smaller_rounds():
    assert explain_nothing_counted(0, 100) is None
    for seen in (1, 99):
        assert explain_nothing_counted(seen, 100).problem == NOT_YET
    assert explain_nothing_counted(100, 100).problem == NO_ROUND


def test_the_threshold_is_where_it_says():
    few, enough = (
        WeightedFailures().after(np.zeros(count), 1000).estimate()
        for count in (int(FEWEST_EFFECTIVE) - 1, int(FEWEST_EFFECTIVE) + 1)
    )
    assert few.probability is None
    assert enough.probability == pytest.approx(0.101)
