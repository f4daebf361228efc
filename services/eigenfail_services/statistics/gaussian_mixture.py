"""Mixtures of normals, fitted to weighted failures, as proposals of importance sampling.

The first components of a proposal are broad: normals around zero that stay fixed. They bound the
weights, and find failures that the fitted components do not reach (Hesterberg 1995, Technometrics
37, 185–194). Further components are fitted to the failures by expectation maximisation (Dempster et
al. 1977).
"""

from collections.abc import Sequence
from math import log, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEAST_BROAD_SHARE = 0.05
"""Smallest share of each broad component, before all shares are scaled to a sum of 1."""

NARROWEST, WIDEST = 0.25, 1.5
"""Bounds of the variance of a fitted component along each of its axes, where that of p(z) is 1.

Failures beyond a plane have a variance near 1 / distance² across it; a proposal as narrow as that
has heavy weights where the plane is a little elsewhere. A region wider than p(z) takes several
components."""

FOLDS = 4

SURE = 0.25
"""Standard errors by which one more component must improve the held-out likelihood."""

FEWEST_PER_COMPONENT = 4

PATIENCE = 3
"""Number of components to try beyond the best number so far: two and three normals describe four
regions around the origin no better than one."""

TRIAL_ITERATIONS, ITERATIONS = 10, 20

TRIAL_STARTS, STARTS = 4, 6
"""Random starts of a fit to a part of the failures, and to all of them. With two starts, one of
four regions was lost in one of 25 runs."""

LEAST_SHARE = 1e-3
"""Share below which a fitted component is removed."""

TINY = 1e-300


class WeightedSamples(NamedTuple):
    """Samples that a mixture is fitted to.

    Attributes:
        z: shape (n, size).
        weights: shape (n,), above 0.
        broad: broad components of the mixture.
    """

    z: Array
    weights: Array
    broad: tuple["NormalComponent", ...]

    def select(self, chosen: NDArray[np.bool_]) -> "WeightedSamples":
        """Return the samples of a mask."""
        return WeightedSamples(self.z[chosen], self.weights[chosen], self.broad)


class NormalComponent(NamedTuple):
    """A normal in principal axes.

    Attributes:
        mean: shape (size,).
        axes: orthonormal axes as columns, shape (size, size); None if all variances are equal,
            because any axes are then principal axes.
        variances: variance along each axis, shape (size,).
    """

    mean: Array
    axes: Array | None
    variances: Array

    def log_density(self, z: Array) -> Array:
        """Return the log density of z of shape (n, size), shape (n,)."""
        away = z - self.mean
        along = away if self.axes is None else away @ self.axes
        exponents = np.square(along) @ (1.0 / self.variances)
        constant = np.log(self.variances).sum() + len(self.mean) * log(2.0 * pi)
        density: Array = -0.5 * (exponents + constant)
        return density

    def transform(self, standard: Array) -> Array:
        """Turn standard normal values of shape (n, size) into draws of this normal.

        It uses the symmetric root of the covariance, because LAPACK chooses the signs of the axes,
        and these must not change the draws.
        """
        deviations = np.sqrt(self.variances)
        if self.axes is None:
            scaled: Array = self.mean + standard * deviations
            return scaled
        moved: Array = self.mean + ((standard @ self.axes) * deviations) @ self.axes.T
        return moved


def make_round_component(mean: Array, variance: float = 1.0) -> NormalComponent:
    """Return a normal with the same variance in all directions."""
    return NormalComponent(mean, None, np.full(len(mean), variance))


class MixtureProposal(NamedTuple):
    """q(z) = sum_k shares_k · N(z; component k).

    Attributes:
        shares: shape (components,), with sum 1.
        components: components, the broad ones first.
        broad: number of broad components.
    """

    shares: Array
    components: tuple[NormalComponent, ...]
    broad: int

    def log_density(self, z: Array) -> Array:
        """Return log q(z) for z of shape (n, size), shape (n,)."""
        density: Array = np.logaddexp.reduce(self.log_joint_densities(z))
        return density

    def log_joint_densities(self, z: Array) -> Array:
        """Return log(shares_k · N(z; component k)), shape (components, n)."""
        each = [component.log_density(z) for component in self.components]
        joint: Array = np.log(self.shares)[:, None] + np.stack(each)
        return joint

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """Draw noise, shape (count, size).

        The number of draws from each component differs from its share by less than one (systematic
        resampling, Kitagawa 1996, J. Comput. Graph. Stat. 5, 1–25).
        """
        at = (np.arange(count) + rng.random()) / max(count, 1)
        chosen = np.searchsorted(np.cumsum(self.shares)[:-1], at, side="right")
        z = rng.standard_normal((count, len(self.components[0].mean)))
        for number, component in enumerate(self.components):
            of_it = chosen == number
            z[of_it] = component.transform(z[of_it])
        shuffled: Array = rng.permutation(z)
        return shuffled

    def even_out(self) -> "MixtureProposal":
        """Return the mixture with the fitted components' shares moved halfway to equal shares."""
        fitted = self.shares[self.broad :]
        shares = np.concatenate([self.shares[: self.broad], 0.5 * (fitted + fitted.mean())])
        return self._replace(shares=shares)

    def join(self, other: "MixtureProposal", share: float) -> "MixtureProposal":
        """Return this mixture with a share of another mixture's fitted components."""
        added = other.shares[other.broad :]
        shares = np.concatenate([(1.0 - share) * self.shares, share * added / added.sum()])
        components = (*self.components, *other.components[other.broad :])
        return MixtureProposal(shares, components, self.broad)


def make_prior_proposal(size: int) -> MixtureProposal:
    """Return p(z) as a proposal: one standard normal."""
    return make_scaled_proposal(size, 1.0)


def make_scaled_proposal(size: int, scale: float) -> MixtureProposal:
    """Return p(z / scale) as a proposal: one normal around zero."""
    component = make_round_component(np.zeros(size), scale**2)
    return MixtureProposal(np.ones(1), (component,), 1)


def add_broad_components(
    fitted: MixtureProposal, broad: Sequence[NormalComponent]
) -> MixtureProposal:
    """Add broad components, with their smallest share each, to a mixture without any."""
    rest = 1.0 - LEAST_BROAD_SHARE * len(broad)
    shares = np.concatenate([np.full(len(broad), LEAST_BROAD_SHARE), rest * fitted.shares])
    return MixtureProposal(shares, (*broad, *fitted.components), len(broad))


def fit_mixture(
    z: Array,
    weights: Array,
    most: int,
    broad: Sequence[NormalComponent],
    rng: np.random.Generator,
) -> MixtureProposal:
    """Return the mixture with the best held-out likelihood of weighted samples.

    Args:
        z: samples, shape (n, size), n at least 2.
        weights: shape (n,), above 0.
        most: maximum number of fitted components.
        broad: broad components; their shares are fitted, but at least `LEAST_BROAD_SHARE` before
            scaling.
        rng: generator of the folds and of the starts.
    """
    samples = WeightedSamples(z, weights, tuple(broad))
    folds = rng.permutation(len(z)) % FOLDS
    best, scores = 1, _score_held_out(samples, 1, folds, rng)
    for count in range(2, most + 1):
        if len(z) < FEWEST_PER_COMPONENT * (count + 1) or count > best + PATIENCE:
            break
        more = _score_held_out(samples, count, folds, rng)
        gain = (more - scores) * weights / weights.mean()
        if gain.mean() > SURE * gain.std() / sqrt(len(z)):
            best, scores = count, more
    starts = [_choose_means(samples, best, rng) for _ in range(STARTS if best > 1 else 1)]
    return _fit_from_starts(samples, starts, ITERATIONS)


def _score_held_out(
    samples: WeightedSamples, count: int, folds: NDArray[np.intp], rng: np.random.Generator
) -> Array:
    """Return each sample's log-likelihood under a fit to the remaining folds, shape (n,)."""
    scores = np.zeros(len(samples.z))
    for fold in np.unique(folds):
        left = folds != fold
        if left.any():
            others = samples.select(left)
            tries = TRIAL_STARTS if count > 1 else 1
            starts = [_choose_means(others, count, rng) for _ in range(tries)]
            fit = _fit_from_starts(others, starts, TRIAL_ITERATIONS)
            scores[~left] = fit.log_density(samples.z[~left])
    return scores


def _fit_from_starts(
    samples: WeightedSamples, starts: Sequence[Sequence[Array]], iterations: int
) -> MixtureProposal:
    """Return the most likely fit from several sets of initial means."""
    fits = [_maximise_likelihood(samples, means, iterations) for means in starts]
    return max(fits, key=lambda fit: float(samples.weights @ fit.log_density(samples.z)))


def _choose_means(samples: WeightedSamples, count: int, rng: np.random.Generator) -> list[Array]:
    """Return samples that lie apart (k-means++, Arthur and Vassilvitskii 2007)."""
    z, weights, _ = samples
    means = [z[rng.choice(len(z), p=weights / weights.sum())]]
    nearest = np.full(len(z), np.inf)
    while len(means) < count:
        nearest = np.minimum(nearest, np.square(z - means[-1]).sum(axis=1))
        odds = nearest * weights
        # All other samples are equal to a mean: there is nothing left to choose.
        if not odds.sum() > 0.0:
            break
        means.append(z[rng.choice(len(z), p=odds / odds.sum())])
    return means


def _maximise_likelihood(
    samples: WeightedSamples, means: Sequence[Array], iterations: int
) -> MixtureProposal:
    """Run expectation maximisation with initial means."""
    z, weights, broad = samples
    components = (*broad, *(make_round_component(mean) for mean in means))
    even = np.full(len(components), 1.0 / len(components))
    mixture = MixtureProposal(even, components, len(broad))
    of_broad = [component.log_density(z) for component in broad]
    for _ in range(iterations):
        of_fitted = [one.log_density(z) for one in mixture.components[len(broad) :]]
        joint = np.log(mixture.shares)[:, None] + np.stack([*of_broad, *of_fitted])
        memberships = np.exp(joint - np.logaddexp.reduce(joint)) * weights
        shares = memberships.sum(axis=1) / weights.sum()
        kept = [k for k in range(len(broad), len(shares)) if shares[k] > LEAST_SHARE]
        # One stays at least: `even_out` and `join` share out what the fitted ones have.
        kept = kept or [len(broad) + int(shares[len(broad) :].argmax())]
        # A component far from all samples has memberships of 0, and its mean would divide by 0.
        fitted = [_fit_component(z, memberships[k] + TINY) for k in kept]
        least_broad = np.maximum(shares[: len(broad)], LEAST_BROAD_SHARE)
        chosen = np.concatenate([least_broad, np.maximum(shares[kept], LEAST_SHARE)])
        mixture = MixtureProposal(chosen / chosen.sum(), (*broad, *fitted), len(broad))
    return mixture


def _fit_component(z: Array, weights: Array) -> NormalComponent:
    """Return a normal for weighted samples; with fewer samples, it is shrunk more.

    The mean is James and Stein's (1961), towards zero. The covariance is shrunk towards the
    covariance of p(z), by the ratio of its sampling variance to its squared distance from it
    (Ledoit and Wolf 2004, J. Multivar. Anal. 88, 365–411). With fewer than two effective samples
    per dimension (plus two), the covariance of p(z) itself is used.
    """
    size, total = z.shape[1], weights.sum()
    effective = total**2 / np.square(weights).sum()
    mean = weights @ z / total
    length = float(mean @ mean)
    if size > 2 and length > 0.0:
        mean = mean * max(0.0, 1.0 - (size - 2) / (effective * length))
    if effective < 2 * size + 2:
        return make_round_component(mean)
    away = z - mean
    covariance = (weights[:, None] * away).T @ away / total
    distance = float(np.square(covariance - np.eye(size)).sum())
    shrinkage = min(1.0, (size**2 + size) / (effective * max(distance, TINY)))
    covariance = (1.0 - shrinkage) * covariance + shrinkage * np.eye(size)
    variances, axes = np.linalg.eigh(covariance)
    return NormalComponent(mean, axes, np.clip(variances, NARROWEST, WIDEST))
