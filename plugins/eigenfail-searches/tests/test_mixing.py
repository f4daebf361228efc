"""R-hat and effective sample size, against closed forms."""

from math import isinf, isnan

import numpy as np
import pytest

from eigenfail_searches.chains.mixing import compute_bulk_ess, compute_r_hat, split_chains


def autoregressive(phi, draws, chains, seed=0):
    """Stationary chains x_t = phi·x_{t−1} + e_t of unit variance."""
    rng = np.random.default_rng(seed)
    x = np.empty((draws, chains))
    x[0] = rng.standard_normal(chains)
    for t in range(1, draws):
        x[t] = phi * x[t - 1] + np.sqrt(1 - phi**2) * rng.standard_normal(chains)
    return x


def test_independent_draws_are_worth_themselves():
    draws = np.random.default_rng(1).standard_normal((1000, 8))
    assert compute_r_hat(draws) == pytest.approx(1.0, abs=0.005)
    assert compute_bulk_ess(draws) == pytest.approx(8000, rel=0.1)


@pytest.mark.parametrize("phi", [0.5, 0.9, -0.5])
def test_the_ess_of_ar1_is_the_closed_form(phi):
    """ESS of the mean of AR(1): n (1 − phi) / (1 + phi)."""
    draws = autoregressive(phi, 4000, 10)
    expected = draws.size * (1 - phi) / (1 + phi)
    assert compute_bulk_ess(draws) == pytest.approx(expected, rel=0.15)
    assert compute_r_hat(draws) < 1.02


def test_monotone_changes_of_the_values_change_nothing():
    draws = autoregressive(0.7, 500, 4)
    assert compute_bulk_ess(np.exp(3 * draws)) == pytest.approx(compute_bulk_ess(draws))
    folded_too = compute_r_hat(5.0 - 2.0 * draws)
    assert folded_too == pytest.approx(compute_r_hat(draws))


def test_chains_in_two_places_have_not_mixed():
    rng = np.random.default_rng(2)
    draws = rng.standard_normal((500, 6)) + np.where(np.arange(6) % 2, 3.0, -3.0)
    assert compute_r_hat(draws) > 1.5
    assert compute_bulk_ess(draws) < 20


def test_a_chain_that_drifts_has_not_mixed():
    """Each half has another mean: without splitting, a single chain would look settled."""
    draws = np.random.default_rng(3).standard_normal((400, 1)) + np.linspace(-3, 3, 400)[:, None]
    assert compute_r_hat(draws) > 1.3


def test_chains_that_differ_only_in_spread_have_not_mixed():
    """Folding shows what means cannot."""
    draws = np.random.default_rng(4).standard_normal((1000, 4)) * np.array([0.2, 1.0, 1.0, 3.0])
    assert compute_r_hat(draws) > 1.1


def test_chains_that_do_not_move():
    still = np.ones((20, 1)) * np.arange(4.0)
    assert isinf(compute_r_hat(still))
    assert compute_bulk_ess(still) <= 8
    assert isnan(compute_r_hat(np.ones((20, 4))))
    assert isnan(compute_bulk_ess(np.ones((20, 4))))


def test_ties_are_no_trouble():
    draws = np.random.default_rng(5).integers(0, 4, (1000, 4)).astype(float)
    assert compute_r_hat(draws) == pytest.approx(1.0, abs=0.01)
    assert compute_bulk_ess(draws) == pytest.approx(4000, rel=0.15)


def test_the_middle_draw_is_left_out():
    assert split_chains(np.arange(5.0)[:, None]).tolist() == [[0.0, 3.0], [1.0, 4.0]]
