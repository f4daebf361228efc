"""How many modes an elite has, and where: the mixture by expectation and maximisation."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenfail.values import Floats
from eigenfail_services.methods.difs.mixture import Array, Mixture

FOLDS = 5

ITERATIONS = 10

SURE = 0.5
"""Standard errors by which one component more must foretell better."""

APART = 2.0
"""Nearer means make no two modes: their normals of unit variance have one common peak."""

GAP = 0.25
"""Most that `scatter` may be; of one normal that is cut in two it is 1 - 2 / pi = 0.36."""

NARROWEST, WIDEST = 1e-2, 1.0
"""Bounds of the variance: what is wider than the prior needs more components."""

TINY = 1e-12


class Elite(NamedTuple):
    """What is fitted, each of shape (n, size).

    Attributes:
        z: zero where nothing was seen.
        seen: which of z are noise of the trajectory's own.
        smoothed: z averaged over small shifts in time; means are averages of this.
    """

    z: Array
    seen: NDArray[np.bool_]
    smoothed: Array


def elite(z: Floats, unseen: NDArray[np.bool_], shift: int) -> Elite:
    """Trajectories z, shape (n, horizon, 2), averaged over shifts by so many steps at most.

    Where a trajectory has no noise of its own, shape (n, horizon), the mean is the prior's: zero.
    """
    filled = np.where(unseen[..., None], 0.0, z).astype(np.float64)
    padded = np.pad(filled, ((0, 0), (shift, shift), (0, 0)))
    steps, rows = z.shape[1], (len(z), -1)
    moved = [padded[:, first : first + steps] for first in range(2 * shift + 1)]
    smoothed: Array = np.mean(moved, axis=0)
    return Elite(filled.reshape(rows), np.repeat(~unseen, 2, axis=1), smoothed.reshape(rows))


class Fits(NamedTuple):
    """Mixtures fitted side by side, each to other trajectories.

    Attributes:
        shares: shape (fits, components).
        means: shape (fits, components, size).
        variance: of all components of a fit, shape (fits,).
    """

    shares: Array
    means: Array
    variance: Array


def fit(given: Elite, most: int) -> Mixture:
    """The mixture of as many components, `most` at most, as foretell held-out trajectories best.

    One component more must do so by half a standard error, and leave a gap. For this comparison
    components share a variance that is fitted: in the directions that matter an elite is narrower
    than the prior, and normals of unit variance would see its modes too late to keep them all.
    """
    count = len(given.z)
    fold = np.arange(count) % FOLDS
    trained = np.ones((FOLDS + 1, count, 1))
    trained[fold, np.arange(count)] = 0.0
    belongs, fits = trained, maximised(trained, given)
    scores = foretold(given, fits, fold)
    for _ in range(1, most if count >= 2 * FOLDS else 1):
        belongs, more = learnt(split(belongs, fits, given), trained, given)
        gain = foretold(given, more, fold) - scores
        sure = gain.mean() > SURE * gain.std() / np.sqrt(count)
        if not (sure and distinct(given, more, fold)):
            break
        fits, scores = more, scores + gain
    return Mixture(fits.shares[-1], fits.means[-1])


def foretold(given: Elite, fits: Fits, fold: NDArray[np.intp]) -> Array:
    """log-likelihood of each trajectory under the fit that it is no part of, shape (n,)."""
    logs = log_densities(given, fits)[fold, np.arange(len(fold))]
    top = logs.max(axis=1)
    score: Array = top + np.log(np.exp(logs - top[:, None]).sum(axis=1))
    return score


def distinct(given: Elite, fits: Fits, fold: NDArray[np.intp]) -> bool:
    """Whether the means lie apart, and few held-out trajectories in the middle of two."""
    return nearest(fits.means[-1]) > APART and scatter(given, fits, fold) <= GAP


def scatter(given: Elite, fits: Fits, fold: NDArray[np.intp]) -> float:
    """Var |y| / E[y²] of held-out trajectories, near 0 where there is a gap.

    y is the distance from the middle of the two means that fit best, along their line.
    """
    each = np.arange(len(fold))
    order = log_densities(given, fits)[fold, each].argsort(axis=1)
    one, other = (fits.means[fold, order[:, -k]] for k in (1, 2))
    middle = np.where(given.seen, 0.5 * (one + other), 0.0)
    away = np.where(given.seen, one - other, 0.0)
    length = np.maximum(np.linalg.norm(away, axis=1), TINY)
    y = np.abs(((given.z - middle) * away).sum(axis=1) / length)
    return float(y.var() / max(float((y**2).mean()), TINY))


def learnt(belongs: Array, trained: Array, given: Elite) -> tuple[Array, Fits]:
    """What belongs to which component in the end, and the fits (Dempster et al. 1977).

    Args:
        belongs: what belongs to which in the beginning, shape (fits, n, components).
        trained: 1 where a trajectory is part of a fit, shape (fits, n, 1), else 0.
        given: the trajectories.
    """
    fits = maximised(belongs, given)
    for _ in range(ITERATIONS):
        logs = log_densities(given, fits)
        density = np.exp(logs - logs.max(axis=2, keepdims=True))
        belongs = trained * density / density.sum(axis=2, keepdims=True)
        fits = maximised(belongs, given)
    return belongs, fits


def maximised(belongs: Array, given: Elite) -> Fits:
    """Shares, means and variance, given what belongs where, shape (fits, n, components)."""
    sizes = belongs.sum(axis=1)
    weights = belongs / np.maximum(sizes, TINY)[:, None]
    means = weights.transpose(0, 2, 1) @ given.smoothed
    numbers = belongs.sum(axis=2) @ given.seen.sum(axis=1)
    squares = (belongs * squared_distances(given, means)).sum(axis=(1, 2))
    variance = np.clip(squares / np.maximum(numbers, 1.0), NARROWEST, WIDEST)
    return Fits(sizes / np.maximum(sizes.sum(axis=1, keepdims=True), TINY), means, variance)


def split(belongs: Array, fits: Fits, given: Elite) -> Array:
    """The component that scatters most in two, along the direction in which it does.

    Returns:
        What belongs where, shape (fits, n, components + 1).
    """
    each = np.arange(len(belongs))
    most = (belongs * squared_distances(given, fits.means)).sum(axis=1).argmax(axis=1)
    whole = belongs[each, :, most]
    away = whole[..., None] * (given.smoothed - fits.means[each, most][:, None])
    direction = np.linalg.svd(away, full_matrices=False)[2][:, 0]
    moved = whole * ((away @ direction[..., None])[..., 0] > 0.0)
    left = belongs.copy()
    left[each, :, most] -= moved
    return np.concatenate([left, moved[..., None]], axis=2)


def log_densities(given: Elite, fits: Fits) -> Array:
    """log(share · density) but for a constant of each trajectory, (fits, n, components)."""
    variance = fits.variance[:, None, None]
    widths = given.seen.sum(axis=1)[:, None] * np.log(variance)
    exponents = squared_distances(given, fits.means) / variance
    logs: Array = np.log(np.maximum(fits.shares, TINY))[:, None] - 0.5 * (exponents + widths)
    return logs


def squared_distances(given: Elite, means: Array) -> Array:
    """Of what was seen from the means, shape (fits, n, components)."""
    squares = (given.z**2).sum(axis=1)[:, None]
    across = given.z @ means.transpose(0, 2, 1)
    seen = given.seen.astype(np.float64)
    distances: Array = squares - 2.0 * across + seen @ (means**2).transpose(0, 2, 1)
    return distances


def nearest(means: Array) -> float:
    """The smallest distance of two means, shape (components, size)."""
    distances = np.linalg.norm(means[:, None] - means, axis=2)
    return float(distances[np.triu_indices(len(means), 1)].min())
