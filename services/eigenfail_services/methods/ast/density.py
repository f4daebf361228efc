"""The density of what a policy chose: log p(z) − log q(z) of whole episodes."""

from collections.abc import Sequence
from math import erfc, log, pi, sqrt, tanh

import numpy as np
from numpy.typing import NDArray

from eigenfail.values import EpisodeResult, Floats, Layer, Policy

Array = NDArray[np.float64]

LOG_STD_MIN, LOG_STD_MAX = -20.0, 2.0
HALF_LOG_TWO_PI = 0.5 * log(2.0 * pi)

EDGE = 5.0
"""Before the squashing; what lies beyond makes one cell, for float32 has few numbers so near ±1.

The cell is 1e-4 of the amplitude wide: its mass under q, over its width, is the density in it."""

NARROWEST = 0.01
"""Standard deviation before the squashing below which the rounding of float32, up to 2e-4 within
the edge, would be seen in the density."""


def log_weights(results: Sequence[EpisodeResult], policy: Policy) -> Array:
    """log p(z) − log q(z) of episodes of one policy that holds no action, shape (n,).

    q(z) is the product over steps of the policy's density given what was seen, up to the episode's
    own end (Siegmund 1976, Annals of Statistics 4, 673–684). Not a number where a choice was all
    but certain.

    Args:
        results: with their states, each from this policy.
        policy: with hold = 1.
    """
    return np.array([log_weight(result, policy) for result in results], np.float64)


def log_weight(result: EpisodeResult, policy: Policy) -> float:
    """log p(z) − log q(z) of one episode."""
    mean, log_std = gaussian(policy, np.asarray(result.states, np.float64))
    if log_std.min() < log(NARROWEST):
        return float("nan")
    z = result.noise.z.astype(np.float64)
    own = log_density(z, mean, np.exp(log_std), float(np.float32(policy.amplitude)))
    return float(np.sum(-0.5 * z**2 - HALF_LOG_TWO_PI - own))


def gaussian(policy: Policy, states: Array) -> tuple[Array, Array]:
    """Mean and log standard deviation before the squashing, each of shape (steps, 2).

    Args:
        policy: whose choice it is.
        states: what it saw, shape (steps, len(STATE)).
    """
    hidden = states
    for layer in policy.hidden:
        hidden = np.maximum(_affine(layer, hidden), 0.0)
    log_std = np.clip(_affine(policy.log_std, hidden), LOG_STD_MIN, LOG_STD_MAX)
    return _affine(policy.mean, hidden), log_std


def log_density(z: Array, mean: Array, std: Array, amplitude: float) -> Array:
    """log of the density of z = amplitude · tanh(u), u ~ N(mean, std²), of the shape of z.

    log N(u; mean, std²) − log(amplitude · (1 − tanh(u)²)) (Haarnoja et al. 2018, appendix C).

    Args:
        z: what was chosen. [sigma]
        mean: of u, of the shape of z.
        std: of u, of the shape of z.
        amplitude: above 0. [sigma]
    """
    squashed = z / amplitude
    outside = np.abs(squashed) > tanh(EDGE)
    inner = np.where(outside, 0.0, squashed)
    inside = -0.5 * ((np.arctanh(inner) - mean) / std) ** 2 - np.log(std) - HALF_LOG_TWO_PI
    inside -= np.log(amplitude * (1.0 - inner**2))
    if outside.any():
        beyond = ((EDGE - np.sign(z) * mean) / std)[outside]
        inside[outside] = log_tail(beyond) - log(amplitude * (1.0 - tanh(EDGE)))
    found: Array = inside
    return found


def log_tail(x: Array) -> Array:
    """log of the standard normal's mass beyond x, shape (n,); its asymptote where x > 30."""
    return np.array(
        [
            log(0.5 * erfc(one / sqrt(2.0)))
            if one < 30.0
            else -0.5 * one**2 - log(one) - HALF_LOG_TWO_PI
            for one in x.tolist()
        ]
    )


def _affine(layer: Layer, x: Array) -> Array:
    weight: Floats = layer.weight
    product: Array = x @ weight.T.astype(np.float64) + layer.bias
    return product
