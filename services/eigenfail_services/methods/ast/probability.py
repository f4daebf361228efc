"""Estimate of the failure probability by importance sampling from policies."""

from collections.abc import Sequence
from math import erfc, log, pi, sqrt, tanh
from statistics import NormalDist

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.values.arrays import Floats, decode_array, encode_array
from eigenfail.values.episode import EpisodeResult
from eigenfail.values.estimates import Estimate
from eigenfail.values.learning import Layer, Policy
from eigenfail.values.shapes import PerChannel
from eigenfail_services.methods.ast.decisions import is_usable
from eigenfail_services.statistics.importance import WeightedFailures, explain_nothing_counted

Array = NDArray[np.float64]

LOG_STD_MIN, LOG_STD_MAX = -20.0, 2.0
HALF_LOG_TWO_PI = 0.5 * log(2.0 * pi)

WEIGHED_FROM = 0.5
"""Share of the budget after which episodes are weighted."""

EDGE = 5.0
"""Largest value before the squashing that has a density of its own.

Beyond it, float32 has few numbers so near ±1: all of them count as one cell of 1e-4 of the
amplitude, whose density is its mass under q divided by its width."""

MIN_STD = 0.01
"""Least standard deviation before the squashing: below it, the rounding of float32, up to 2e-4
within the edge, would falsify the density."""


def log_weights(results: Sequence[EpisodeResult], policy: Policy) -> Array:
    """Return log p(z) − log q(z) for episodes of one policy with hold = 1, shape (n,).

    q(z) is the product over steps of the policy's density given its state, up to the episode's own
    end (Siegmund 1976, Annals of Statistics 4, 673–684). NaN if a choice was almost certain.

    Args:
        results: results of this policy's episodes, with their states.
        policy: policy with hold = 1.
    """
    return np.array([log_weight(result, policy) for result in results], np.float64)


def log_weight(result: EpisodeResult, policy: Policy) -> float:
    """Return log p(z) − log q(z) of one episode."""
    mean, log_std = compute_gaussian(policy, np.asarray(result.states, np.float64))
    # One such step spoils the whole product: the sums report it as an unknown weight.
    if log_std.min() < log(MIN_STD):
        return float("nan")
    z = result.noise.z.astype(np.float64)
    # The amplitude in float32, as workers multiply by it.
    own = log_density(z, mean, np.exp(log_std), float(np.float32(policy.amplitude)))
    weights = -0.5 * z**2 - HALF_LOG_TWO_PI - own
    shape = result.noise.shape
    if isinstance(shape, PerChannel):
        # What is drawn once comes from p itself, whatever the policy says.
        weights[:, shape.once] = 0.0
    return float(np.sum(weights))


def compute_gaussian(policy: Policy, states: Array) -> tuple[Array, Array]:
    """Return mean and log standard deviation before the squashing, each (steps, channels).

    Args:
        policy: policy that chose the noise.
        states: states that the policy observed, shape (steps, count_state(channels)).
    """
    hidden = states
    for layer in policy.hidden:
        hidden = np.maximum(_affine(layer, hidden), 0.0)
    log_std = np.clip(_affine(policy.log_std, hidden), LOG_STD_MIN, LOG_STD_MAX)
    return _affine(policy.mean, hidden), log_std


def log_density(z: Array, mean: Array, std: Array, amplitude: float) -> Array:
    """Return the log density of z = amplitude · tanh(u), u ~ N(mean, std²), like z in shape.

    log N(u; mean, std²) − log(amplitude · (1 − tanh(u)²)) (Haarnoja et al. 2018, appendix C).

    Args:
        z: chosen noise. [sigma]
        mean: mean of u, shaped like z.
        std: standard deviation of u, shaped like z.
        amplitude: above 0. [sigma]
    """
    squashed = z / amplitude
    # arctanh of a rounded ±1 is infinite.
    outside = np.abs(squashed) > tanh(EDGE)
    inner = np.where(outside, 0.0, squashed)
    inside = -0.5 * ((np.arctanh(inner) - mean) / std) ** 2 - np.log(std) - HALF_LOG_TWO_PI
    inside -= np.log(amplitude * (1.0 - inner**2))
    if outside.any():
        beyond = ((EDGE - np.sign(z) * mean) / std)[outside]
        inside[outside] = _log_tail_probability(beyond) - log(amplitude * (1.0 - tanh(EDGE)))
    found: Array = inside
    return found


def _log_tail_probability(x: Array) -> Array:
    """Return log P(X > x) for a standard normal X, shape (n,); its asymptote from x = 30 on."""
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


ADVICE = (
    "Take method subset, or give it more episodes and a policy that stays more random: "
    "target_entropy = 0.5."
)
ONE_POLICY = (
    "Importance sampling from one policy sees the failure regions that the policy leads to; others "
    "are missed, so the true probability may be larger. Its own random error is not taken off."
)
_encoder = msgspec.msgpack.Encoder(enc_hook=encode_array)
_policies = msgspec.msgpack.Decoder(dict[int, Policy], dec_hook=decode_array)


class PolicyProbability:
    """Sums of importance weights over the rounds of the second half of the budget.

    The first half is left out, because few heavy weights of the early policies would dominate the
    sum. A policy never depends on the round that it runs, so the sums are unbiased during training.
    With hold > 1, weights do not exist: held noise lies in a set with probability 0 under p(z).

    Args:
        hold: number of steps for which an action is held.
        budget: budget of the campaign, in episodes.
        channels: number of channels of the noise.

    Attributes:
        sums: sums over the weighted episodes.
    """

    def __init__(self, hold: int, budget: int, channels: int) -> None:
        self._has_density = hold == 1
        self._budget = budget
        self._channels = channels
        self._open: dict[int, Policy] = {}
        self.sums = WeightedFailures()

    def begin(self, first: int, policy: Policy) -> None:
        """Record the policy of the round that begins with episode `first`."""
        if self._has_density and first >= WEIGHED_FROM * self._budget:
            self._open[first] = policy

    def end(self, first: int, results: Sequence[EpisodeResult]) -> None:
        """Add the results of the round that began with episode `first`."""
        if (policy := self._open.pop(first, None)) is not None:
            self.sums = self.weigh(self.sums, results, policy)

    def weigh(
        self, sums: WeightedFailures, results: Sequence[EpisodeResult], policy: Policy
    ) -> WeightedFailures:
        """Return the sums with a policy's episodes added; unchanged if noise is held."""
        if not self._has_density:
            return sums
        ran = [result for result in results if is_usable(result)]
        failures = [result for result in ran if result.is_failure]
        return sums.after(log_weights(failures, policy), len(ran))

    def estimate_from_sums(
        self, sums: WeightedFailures, horizon: int, amplitude: float
    ) -> Estimate | None:
        """Return the estimate from given sums; None without episodes.

        Args:
            sums: sums of the weighted episodes.
            horizon: number of steps of a full episode.
            amplitude: largest |z| of the episodes' policies. [sigma]
        """
        note = f"{describe_reach(amplitude, horizon, self._channels)} {ONE_POLICY}"
        return sums.estimate(ADVICE, note) if sums.episodes else None

    def estimate(self, observed: int, horizon: int, amplitude: float) -> Estimate | None:
        """Return the estimate from the campaign's own sums; None if noise is held."""
        if not self._has_density:
            return None
        told = self.estimate_from_sums(self.sums, horizon, amplitude)
        return told or explain_nothing_counted(observed, self._budget)

    def encode_open(self) -> bytes:
        """Return the encoded policies of the open rounds."""
        return _encoder.encode(self._open)

    def load(self, sums: WeightedFailures, policies: dict[int, Policy]) -> None:
        """Restore the state."""
        self.sums, self._open = sums, policies


def read_open_policies(data: bytes) -> dict[int, Policy]:
    """Return the policies that `encode_open` encoded.

    Raises:
        ValueError: the bytes do not hold policies.
    """
    return _policies.decode(data)


def describe_reach(amplitude: float, horizon: int, channels: int) -> str:
    """Describe the noise that the policy can choose, and its share of all noise."""
    share = (2.0 * NormalDist().cdf(amplitude) - 1.0) ** (channels * horizon)
    return (
        f"A lower bound: it counts failures whose noise stays within ±{amplitude:g} sigma at every "
        f"step, as {100.0 * share:.3g} % of all noise does over {horizon} steps."
    )
