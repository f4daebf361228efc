"""The density of a policy's episodes: by hand, against integrals, and at its edges."""

from math import atanh, exp, log, pi, tanh

import msgspec
import numpy as np
import pytest

from eigenfail.testing.learner import Corridor, ToyEngine
from eigenfail.values.episode import EpisodeTask, PolicySource, episode_seed
from eigenfail.values.learning import STATE, Layer, Policy
from eigenfail.values.shapes import Once, PerChannel, White
from eigenfail_services.methods.ast.probability import (
    EDGE,
    MIN_STD,
    _log_tail_probability,
    compute_gaussian,
    log_density,
    log_weights,
)

LAST_NOISE = STATE.index("noise_x")


def policy(mean=(0.0, 0.0), std=1.0, amplitude=2.0, hold=1, memory=0.0):
    """Mean and standard deviation that are the same in all states, but for `memory`.

    Args:
        memory: how much the mean of either axis rises with the last longitudinal noise, per 3
            sigma, where that is above 0.
    """
    seen = np.zeros((1, len(STATE)), np.float32)
    seen[0, LAST_NOISE] = 1.0
    zero = np.zeros((2, 1), np.float32)
    return Policy(
        version=0,
        hidden=(Layer(seen, np.zeros(1, np.float32)),),
        mean=Layer(np.full((2, 1), memory, np.float32), np.array(mean, np.float32)),
        log_std=Layer(zero, np.full(2, log(std), np.float32)),
        amplitude=amplitude,
        hold=hold,
    )


def states(steps, last=0.0):
    found = np.zeros((steps, len(STATE)), np.float32)
    found[:, LAST_NOISE] = last
    return found


def normal(x, mean=0.0, std=1.0):
    return exp(-0.5 * ((x - mean) / std) ** 2) / (std * (2.0 * pi) ** 0.5)


def test_the_weight_of_an_episode_by_hand(episode):
    """Two steps; the second mean is 0.1 + 0.5 · 1, since 3 sigma of noise went before."""
    chosen = policy(mean=(0.1, 0.1), std=0.5, amplitude=4.0, memory=0.5)
    seen = states(2)
    seen[1, LAST_NOISE] = 1.0
    result = episode([(3.0, 0.0), (1.0, -2.0)], states=seen)
    p = normal(3.0) * normal(0.0) * normal(1.0) * normal(-2.0)
    q = 1.0
    for z, mean in ((3.0, 0.1), (0.0, 0.1), (1.0, 0.6), (-2.0, 0.6)):
        q *= normal(atanh(z / 4.0), mean, 0.5) / (4.0 * (1.0 - (z / 4.0) ** 2))
    np.testing.assert_allclose(log_weights([result], chosen), [log(p / q)], rtol=1e-6)


def test_what_is_drawn_once_has_no_weight(episode):
    """It comes from p itself, whatever the policy says of its column."""
    result = episode([(3.0, 2.5), (1.0, 2.5)], states=states(2))
    once = msgspec.structs.replace(result.noise, shape=PerChannel((White(), Once())))
    joint = msgspec.structs.replace(result, noise=once)
    one, other = (policy(mean=(0.1, mean), std=0.5, amplitude=4.0) for mean in (0.0, 1.5))
    assert log_weights([joint], one) == log_weights([joint], other)
    assert log_weights([result], one) != log_weights([result], other)


@pytest.mark.parametrize(("mean", "std"), [(0.0, 1.0), (1.5, 0.3), (4.0, 2.0), (-6.0, 7.0)])
def test_a_density_integrates_to_one_with_the_cells_at_both_ends(mean, std):
    """Over u = atanh(z / amplitude), so that the ends are resolved."""
    u = np.linspace(-EDGE, EDGE, 400_001)
    u = 0.5 * (u[1:] + u[:-1])
    z, step = 3.0 * np.tanh(u), 2.0 * EDGE / 400_000
    inside = (
        np.sum(
            np.exp(log_density(z, np.full_like(z, mean), np.full_like(z, std), 3.0))
            * 3.0
            * (1.0 - np.tanh(u) ** 2)
        )
        * step
    )
    ends = np.array([-3.0, 3.0])
    density = np.exp(log_density(ends, np.full(2, mean), np.full(2, std), 3.0))
    outside = density.sum() * 3.0 * (1.0 - tanh(EDGE))
    assert inside + outside == pytest.approx(1.0, abs=1e-6)


def test_the_tail_goes_over_into_its_asymptote():
    below, above = _log_tail_probability(np.array([30.0 - 1e-9, 30.0 + 1e-9]))
    assert below == pytest.approx(above, rel=1e-5)
    assert _log_tail_probability(np.array([0.0, -40.0])) == pytest.approx([log(0.5), 0.0])
    assert np.isfinite(_log_tail_probability(np.array([1e6]))).all()


def test_noise_at_the_very_edge_has_a_weight(episode):
    """Float32 rounds tanh(9) to 1, of which atanh is infinite."""
    result = episode([(2.0, -2.0)], states=states(1))
    weight = log_weights([result], policy(mean=(9.0, -9.0), std=1.0))
    cell = 2.0 * (1.0 - tanh(EDGE))
    expected = 2.0 * (log(normal(2.0)) + log(cell)) - 2.0 * np.log(0.99996832875817)
    np.testing.assert_allclose(weight, [expected], rtol=1e-6)


def test_what_was_all_but_certain_has_no_density(episode):
    result = episode([(1.0, 1.0)], states=states(1))
    assert np.isnan(log_weights([result], policy(std=0.9 * MIN_STD))).all()
    assert np.isfinite(log_weights([result], policy(std=1.1 * MIN_STD))).all()


def test_deviations_are_clamped_as_where_the_policy_acts():
    _, log_std = compute_gaussian(policy(std=exp(50.0)), states(3).astype(np.float64))
    assert (log_std == 2.0).all()


def test_weighed_draws_are_the_priors_within_the_amplitude():
    """400,000 draws in float32, as they come: their weights add up to the share within ±2.5."""
    random = np.random.default_rng(3043)
    eps = random.standard_normal((400_000, 1), np.float32)
    z = np.float32(2.5) * np.tanh(np.float32(0.3) + np.float32(0.9) * eps)
    mean, std = np.full(z.shape, 0.3), np.full(z.shape, 0.9)
    z = z.astype(np.float64)
    weights = np.exp(-0.5 * z**2 - 0.5 * log(2.0 * pi) - log_density(z, mean, std, 2.5))
    assert weights.mean() == pytest.approx(SHARE, abs=0.005)
    assert (weights * z).mean() == pytest.approx(0.0, abs=0.01)
    assert (weights * (z > 2.0)).mean() == pytest.approx(0.0165405, rel=0.02)


SHARE = 0.987580669348448
"""P(|z| <= 2.5) under p(z)."""


def test_weights_of_a_policy_with_memory_turn_its_episodes_into_the_priors():
    """Three steps within ±2.5 sigma: the mean weight is p's share of them.

    E_q[w · z_t] is that of a truncated normal, 0, in every step, though the policy leans.
    """
    engine, chosen = (
        ToyEngine(Corridor(steps=3, wall=1e9)),
        policy(mean=(0.2, -0.1), std=0.7, amplitude=2.5, memory=0.3),
    )
    engine.add_policy(chosen)
    tasks = [EpisodeTask(i, episode_seed(3043, i), PolicySource(0)) for i in range(4000)]
    results = list(engine.run(tasks))
    weights = np.exp(log_weights(results, chosen))
    noise = np.stack([result.noise.z for result in results]).astype(np.float64)
    assert noise[:, :, 0].mean() > 0.2
    error = weights.std() / 4000**0.5
    assert weights.mean() == pytest.approx(SHARE**6, abs=4.0 * error)
    assert error < 0.05
    for axis in range(2):
        for step in range(3):
            weighed = weights * noise[:, step, axis]
            assert abs(weighed.mean()) < 4.0 * weighed.std() / 4000**0.5
