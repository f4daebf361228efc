"""What the cross-entropy method draws from: a Gaussian for every step and axis of the noise."""

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.values import Floats

Array = NDArray[np.float64]


class GaussianProposal(msgspec.Struct, frozen=True, eq=False):
    """q(z): z_t ~ N(mean_t, diag(std_t²)), every step and axis independent of the others.

    Attributes:
        mean: shape (horizon, 2): longitudinal, lateral. [sigma]
        std: shape (horizon, 2), above 0. [sigma]
    """

    mean: Floats
    std: Floats

    def draw(self, count: int, random: np.random.Generator) -> Floats:
        """Noise trajectories z, shape (count, horizon, 2). [sigma]"""
        eps = random.standard_normal((count, *self.mean.shape), np.float32)
        return self.mean + self.std * eps


def prior(horizon: int) -> GaussianProposal:
    """p(z) itself: mean 0, standard deviation 1."""
    return GaussianProposal(np.zeros((horizon, 2), np.float32), np.ones((horizon, 2), np.float32))


def log_weights(trajectories: Sequence[Floats], proposal: GaussianProposal) -> Array:
    """log p(z) − log q(z) of trajectories drawn from q, shape (n,).

    Each counts up to its own end. Whether an episode ends at a step follows from the noise up to
    there, so that this is the whole weight, and episodes of different lengths can be compared
    (Siegmund 1976, Annals of Statistics 4, 673–684).

    Args:
        trajectories: z of each episode, shape (steps, 2), steps no more than the horizon. [sigma]
        proposal: what they were drawn from.
    """
    return np.array([_log_weight(z.astype(np.float64), proposal) for z in trajectories])


def fit(elite: Sequence[Floats], proposal: GaussianProposal) -> tuple[Array, Array]:
    """Mean and standard deviation of an elite, each of shape (horizon, 2). [sigma]

    Behind its end an episode stands for the prior: no noise was injected there, and any would have
    done. The variance of those that still run has Bessel's correction, or small elites would
    narrow it round after round; where only one runs, the proposal's stands for it.

    Args:
        elite: z of each episode, shape (steps, 2); at least one.
        proposal: what they were drawn from.
    """
    z, running = _padded(elite, len(proposal.mean))
    count = running.sum(axis=0)
    centre = z.sum(axis=0) / np.maximum(count, 1)
    squares = np.where(running, (z - centre) ** 2, 0.0).sum(axis=0)
    unknown = proposal.std.astype(np.float64) ** 2
    variance = np.where(count > 1, squares / np.maximum(count - 1, 1), unknown)
    share = count / len(elite)
    mixed = share * variance + (1.0 - share) * (1.0 + share * centre**2)
    return share * centre, np.sqrt(mixed)


def averaged(values: Array, window: int) -> Array:
    """Moving average over that many steps, fewer at both ends; values of shape (horizon, 2)."""
    first = np.arange(len(values)) - (window - 1) // 2
    last = np.minimum(first + window, len(values))
    first = np.maximum(first, 0)
    sums = np.concatenate([np.zeros((1, 2)), np.cumsum(values, axis=0)])
    mean: Array = (sums[last] - sums[first]) / (last - first)[:, None]
    return mean


def _log_weight(z: Array, proposal: GaussianProposal) -> float:
    mean, std = (part[: len(z)].astype(np.float64) for part in (proposal.mean, proposal.std))
    return float(np.sum(0.5 * ((z - mean) / std) ** 2 - 0.5 * z**2 + np.log(std)))


def _padded(elite: Sequence[Floats], horizon: int) -> tuple[Array, NDArray[np.bool_]]:
    """z with zeros behind each end, shape (n, horizon, 2), and which steps ran, (n, horizon, 1)."""
    z = np.zeros((len(elite), horizon, 2))
    for row, trajectory in zip(z, elite, strict=True):
        row[: len(trajectory)] = trajectory
    ends = np.array([len(trajectory) for trajectory in elite])
    return z, (np.arange(horizon) < ends[:, None])[..., None]
