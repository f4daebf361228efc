"""Modes of an elite: number and means, by expectation maximisation of a mixture of normals."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenfail.values.arrays import Floats

Array = NDArray[np.float64]
Rows = NDArray[np.intp]


class Mixture(NamedTuple):
    """Normals of unit variance, one for each mode: p(z) = sum_k shares_k · N(z; means_k, I).

    Attributes:
        shares: shape (components,), with sum 1.
        means: shape (components, size).
    """

    shares: Array
    means: Array

    def restrict(self, components: Rows) -> "Mixture":
        """Return the mixture of some components by their numbers; of all for no number."""
        if not len(components):
            return self
        shares = self.shares[components]
        return Mixture(shares / shares.sum(), self.means[components])

    def draw_components(self, count: int, random: np.random.Generator) -> Rows:
        """Draw a component for each of `count` samples, shape (count,).

        The counts differ from the shares by less than one (systematic resampling, Kitagawa 1996):
        in small rounds, independent draws would miss components.
        """
        at = (np.arange(count) + random.random()) / max(count, 1)
        return np.searchsorted(np.cumsum(self.shares)[:-1], at, side="right")

    def assign(self, z: Floats, unseen: NDArray[np.bool_]) -> Rows:
        """Return the likeliest component of each trajectory, shape (n,)."""
        if len(self.shares) == 1:
            return np.zeros(len(z), np.intp)
        most: Rows = self.compute_responsibilities(z, unseen).argmax(axis=1)
        return most

    def compute_responsibilities(self, z: Floats, unseen: NDArray[np.bool_]) -> Array:
        """Return P(component | z in the observed steps), shape (n, components).

        Args:
            z: shape (n, horizon, channels). [sigma]
            unseen: steps without own noise of the trajectory, shape (n, horizon).
        """
        seen = np.repeat(~unseen, z.shape[2], axis=1).astype(np.float64)
        across = (z.reshape(seen.shape) * seen) @ self.means.T
        exponents = np.log(self.shares) + across - 0.5 * seen @ (self.means**2).T
        # The largest exponent is taken off, as the products over hundreds of steps would underflow.
        density = np.exp(exponents - exponents.max(axis=1, keepdims=True))
        each: Array = density / density.sum(axis=1, keepdims=True)
        return each


def make_prior_mixture(size: int) -> Mixture:
    """Return the prior as a mixture of one component."""
    return Mixture(np.ones(1), np.zeros((1, size)))


FOLDS = 5

ITERATIONS = 10

SURE = 0.5
"""Standard errors by which another component must improve the held-out likelihood."""

APART = 2.0
"""Least distance of two means: below it, two normals of unit variance have one common peak."""

GAP = 0.25
"""Most that `_compute_scatter` may be; of one normal that is cut in two it is 1 - 2 / pi = 0.36."""

NARROWEST, WIDEST = 1e-2, 1.0
"""Bounds of the variance: a wider elite than the prior needs more components."""

TINY = 1e-12


class Elite(NamedTuple):
    """Trajectories of an elite, each array of shape (n, size).

    Attributes:
        z: zero if no noise was injected.
        seen: whether z was injected.
        smoothed: z averaged over small shifts in time, from which means are computed.
    """

    z: Array
    seen: NDArray[np.bool_]
    smoothed: Array


def prepare_elite(z: Floats, unseen: NDArray[np.bool_], shift: int) -> Elite:
    """Return an elite from z, shape (n, horizon, channels), shifted by at most `shift` steps.

    If no noise was injected, `unseen` of shape (n, horizon), z is the prior's mean: zero.
    """
    filled = np.where(unseen[..., None], 0.0, z).astype(np.float64)
    padded = np.pad(filled, ((0, 0), (shift, shift), (0, 0)))
    steps, rows = z.shape[1], (len(z), -1)
    moved = [padded[:, first : first + steps] for first in range(2 * shift + 1)]
    smoothed: Array = np.mean(moved, axis=0)
    seen = np.repeat(~unseen, z.shape[2], axis=1)
    return Elite(filled.reshape(rows), seen, smoothed.reshape(rows))


class MixtureFits(NamedTuple):
    """Mixtures that are fitted in parallel, each to other trajectories.

    Attributes:
        shares: shape (fits, components).
        means: shape (fits, components, size).
        variance: common to all components of a fit, shape (fits,).
    """

    shares: Array
    means: Array
    variance: Array


def fit_mixture(elite: Elite, most: int) -> Mixture:
    """Return the mixture of at most `most` components with the best held-out likelihood.

    Another component must improve it by half a standard error, and leave a gap. For this comparison
    the components share a fitted variance: in the directions that matter, an elite is narrower than
    the prior, and normals of unit variance would separate its modes too late to keep them all.
    """
    count = len(elite.z)
    fold = np.arange(count) % FOLDS
    # All folds are fitted as one batch. The last fit holds nothing out: it is the answer.
    trained = np.ones((FOLDS + 1, count, 1))
    trained[fold, np.arange(count)] = 0.0
    belongs, fits = trained, _maximise(trained, elite)
    scores = _score_held_out(elite, fits, fold)
    for _ in range(1, most if count >= 2 * FOLDS else 1):
        belongs, more = _run_em(_split_component(belongs, fits, elite), trained, elite)
        gain = _score_held_out(elite, more, fold) - scores
        sure = gain.mean() > SURE * gain.std() / np.sqrt(count)
        if not (sure and _are_distinct(elite, more, fold)):
            break
        fits, scores = more, scores + gain
    return Mixture(fits.shares[-1], fits.means[-1])


def _score_held_out(elite: Elite, fits: MixtureFits, fold: NDArray[np.intp]) -> Array:
    """Return the log-likelihood of each trajectory under the fit without it, shape (n,)."""
    logs = _log_densities(elite, fits)[fold, np.arange(len(fold))]
    top = logs.max(axis=1)
    score: Array = top + np.log(np.exp(logs - top[:, None]).sum(axis=1))
    return score


def _are_distinct(elite: Elite, fits: MixtureFits, fold: NDArray[np.intp]) -> bool:
    """Whether the means are distant, and few held-out trajectories lie between two of them."""
    means = fits.means[-1]
    distances = np.linalg.norm(means[:, None] - means, axis=2)
    least = distances[np.triu_indices(len(means), 1)].min()
    return bool(least > APART) and _compute_scatter(elite, fits, fold) <= GAP


def _compute_scatter(elite: Elite, fits: MixtureFits, fold: NDArray[np.intp]) -> float:
    """Return Var |y| / E[y²] of held-out trajectories, near 0 if there is a gap.

    y is the distance from the centre of the two best fitting means, along their line.
    """
    each = np.arange(len(fold))
    order = _log_densities(elite, fits)[fold, each].argsort(axis=1)
    one, other = (fits.means[fold, order[:, -k]] for k in (1, 2))
    middle = np.where(elite.seen, 0.5 * (one + other), 0.0)
    away = np.where(elite.seen, one - other, 0.0)
    length = np.maximum(np.linalg.norm(away, axis=1), TINY)
    y = np.abs(((elite.z - middle) * away).sum(axis=1) / length)
    return float(y.var() / max(float((y**2).mean()), TINY))


def _run_em(belongs: Array, trained: Array, elite: Elite) -> tuple[Array, MixtureFits]:
    """Run expectation maximisation (Dempster et al. 1977); return memberships and fits.

    Args:
        belongs: initial memberships, shape (fits, n, components).
        trained: 1 if a trajectory is part of a fit, else 0, shape (fits, n, 1).
        elite: trajectories.
    """
    fits = _maximise(belongs, elite)
    for _ in range(ITERATIONS):
        logs = _log_densities(elite, fits)
        density = np.exp(logs - logs.max(axis=2, keepdims=True))
        belongs = trained * density / density.sum(axis=2, keepdims=True)
        fits = _maximise(belongs, elite)
    return belongs, fits


def _maximise(belongs: Array, elite: Elite) -> MixtureFits:
    """Return the fits for memberships of shape (fits, n, components)."""
    sizes = belongs.sum(axis=1)
    weights = belongs / np.maximum(sizes, TINY)[:, None]
    means = weights.transpose(0, 2, 1) @ elite.smoothed
    numbers = belongs.sum(axis=2) @ elite.seen.sum(axis=1)
    squares = (belongs * _squared_distances(elite, means)).sum(axis=(1, 2))
    variance = np.clip(squares / np.maximum(numbers, 1.0), NARROWEST, WIDEST)
    return MixtureFits(sizes / np.maximum(sizes.sum(axis=1, keepdims=True), TINY), means, variance)


def _split_component(belongs: Array, fits: MixtureFits, elite: Elite) -> Array:
    """Split the component with the largest scatter, along its principal direction.

    Returns:
        memberships, shape (fits, n, components + 1).
    """
    each = np.arange(len(belongs))
    most = (belongs * _squared_distances(elite, fits.means)).sum(axis=1).argmax(axis=1)
    whole = belongs[each, :, most]
    away = whole[..., None] * (elite.smoothed - fits.means[each, most][:, None])
    direction = np.linalg.svd(away, full_matrices=False)[2][:, 0]
    # Cut in two by the sign along it: EM moves the border from there.
    moved = whole * ((away @ direction[..., None])[..., 0] > 0.0)
    left = belongs.copy()
    left[each, :, most] -= moved
    return np.concatenate([left, moved[..., None]], axis=2)


def _log_densities(elite: Elite, fits: MixtureFits) -> Array:
    """Return log(share · density) up to a constant of each trajectory, (fits, n, components)."""
    variance = fits.variance[:, None, None]
    widths = elite.seen.sum(axis=1)[:, None] * np.log(variance)
    exponents = _squared_distances(elite, fits.means) / variance
    logs: Array = np.log(np.maximum(fits.shares, TINY))[:, None] - 0.5 * (exponents + widths)
    return logs


def _squared_distances(elite: Elite, means: Array) -> Array:
    """Return distances of the injected noise from the means, shape (fits, n, components)."""
    squares = (elite.z**2).sum(axis=1)[:, None]
    across = elite.z @ means.transpose(0, 2, 1)
    seen = elite.seen.astype(np.float64)
    distances: Array = squares - 2.0 * across + seen @ (means**2).transpose(0, 2, 1)
    return distances
