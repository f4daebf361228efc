"""CMA-ES: an evolution strategy that adapts the covariance matrix of a normal distribution.

Equation numbers refer to Hansen 2016, "The CMA Evolution Strategy: A Tutorial" (arXiv 1604.00772).
The libraries `cma` and `cmaes` can be restored only from pickled objects, and `cma` imports
matplotlib. Here the whole state is one value of arrays.
"""

from math import exp, sqrt

import msgspec
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MAX_CONDITION = 1e14
"""Largest ratio of eigenvalues of the covariance; beyond it rounding makes them negative."""


class EvolutionRates(msgspec.Struct, frozen=True, eq=False):
    """Weights and learning rates, for a dimension and a population size.

    Attributes:
        weights: w_i by rank, best first, shape (population,); below 0 from the middle rank on.
        mu_eff: variance effective selection mass.
        c_sigma: rate of the path that adapts the step.
        d_sigma: damping of the step.
        c_c: rate of the path that adapts the covariance.
        c_1: rate of the covariance's rank-one update.
        c_mu: rate of the covariance's rank-mu update.
        chi: expected length of a standard normal vector.
    """

    weights: Array
    mu_eff: float
    c_sigma: float
    d_sigma: float
    c_c: float
    c_1: float
    c_mu: float
    chi: float


def choose_rates(dimension: int, population: int) -> EvolutionRates:
    """Return the default weights and learning rates (table 1, eqs. 49 to 58).

    Args:
        dimension: number of values of a candidate.
        population: number of candidates of a generation, at least 4: with a single parent c_mu
            would be 0.
    """
    n = dimension
    raw = np.log((population + 1) / 2.0) - np.log(np.arange(1, population + 1))  # (49)
    parents, others = raw[: population // 2], raw[population // 2 :]
    mu_eff = float(np.sum(parents) ** 2 / np.sum(parents**2))
    mu_eff_others = float(np.sum(others) ** 2 / np.sum(others**2))
    c_1 = 2.0 / ((n + 1.3) ** 2 + mu_eff)  # (57)
    # With alpha_cov = 2, the tutorial's default.
    mass = 2.0 * (mu_eff - 2.0 + 1.0 / mu_eff) / ((n + 2.0) ** 2 + mu_eff)
    c_mu = min(1.0 - c_1, mass)  # (58)
    negative = min(
        1.0 + c_1 / c_mu,  # (50)
        1.0 + 2.0 * mu_eff_others / (mu_eff + 2.0),  # (51)
        (1.0 - c_1 - c_mu) / (n * c_mu),  # (52)
    )
    above, below = raw[raw >= 0.0].sum(), -raw[raw < 0.0].sum()
    c_sigma = (mu_eff + 2.0) / (n + mu_eff + 5.0)  # (55)
    return EvolutionRates(
        weights=np.where(raw >= 0.0, raw / above, negative * raw / below),  # (53)
        mu_eff=mu_eff,
        c_sigma=c_sigma,
        d_sigma=1.0 + 2.0 * max(0.0, sqrt((mu_eff - 1.0) / (n + 1.0)) - 1.0) + c_sigma,
        c_c=(4.0 + mu_eff / n) / (n + 4.0 + 2.0 * mu_eff / n),  # (56)
        c_1=c_1,
        c_mu=c_mu,
        chi=sqrt(n) * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n**2)),
    )


class SearchDistribution(msgspec.Struct, frozen=True, eq=False):
    """Distribution N(mean, step² · covariance) of a generation, and the evolution paths.

    Attributes:
        mean: shape (dimension,).
        step: sigma of the tutorial, above 0.
        covariance: C, shape (dimension, dimension).
        path_sigma: p_sigma, shape (dimension,).
        path_c: p_c, shape (dimension,).
        generation: number of updates so far.
    """

    mean: Array
    step: float
    covariance: Array
    path_sigma: Array
    path_c: Array
    generation: int = 0

    def transform(self, normals: Array) -> Array:
        """Return candidates from standard normal numbers, both of shape (n, dimension)."""
        scales, axes = self._decompose()
        candidates: Array = self.mean + self.step * ((normals * scales) @ axes.T)  # (38) to (40)
        return candidates

    def find_largest_deviation(self) -> float:
        """Return the standard deviation along the longest axis."""
        scales, _ = self._decompose()
        return self.step * float(scales[-1])

    def narrow(self, factor: float) -> "SearchDistribution":
        """Return the distribution with its step multiplied by a factor."""
        return msgspec.structs.replace(self, step=self.step * factor)

    def adapt(self, ranked: Array, rates: EvolutionRates) -> "SearchDistribution":
        """Return the distribution of the next generation.

        Args:
            ranked: candidates of this generation, best first, shape (population, dimension).
            rates: weights and learning rates for this dimension and population.
        """
        n, generation = len(self.mean), self.generation + 1
        scales, axes = self._decompose()
        y = (ranked - self.mean) / self.step
        whitened = (y @ axes) / scales  # C^(-1/2) y in the basis of the axes
        parents = np.maximum(rates.weights, 0.0)
        move = parents @ y  # (41)
        # C^(-1/2) times the move: whitened along the axes, and turned back.
        straight = axes @ (parents @ whitened)

        c, mu_eff = rates.c_sigma, rates.mu_eff
        path_sigma = (1.0 - c) * self.path_sigma + sqrt(c * (2.0 - c) * mu_eff) * straight  # (43)
        length = float(np.linalg.norm(path_sigma))
        step = self.step * exp(c / rates.d_sigma * (length / rates.chi - 1.0))  # (44)

        # The path is still short in the first generations, as it starts at 0; h_sigma allows for
        # that.
        settled = sqrt(1.0 - (1.0 - c) ** (2 * (generation + 1)))
        is_short = length / settled < (1.4 + 2.0 / (n + 1.0)) * rates.chi  # h_sigma
        c = rates.c_c
        pushed = sqrt(c * (2.0 - c) * mu_eff) * move if is_short else 0.0
        path_c = (1.0 - c) * self.path_c + pushed  # (45)

        lengths = np.sum(whitened**2, axis=1)
        # Bad candidates that are far away would take more variance off than there is: each counts
        # as if it were at the expected distance. The tiny number spares a division by 0 for one at
        # the mean.
        shrunk = n / np.maximum(lengths, 1e-300)
        weights = rates.weights * np.where(rates.weights >= 0.0, 1.0, shrunk)  # (46)
        missing = 0.0 if is_short else c * (2.0 - c)
        kept = 1.0 + rates.c_1 * missing - rates.c_1 - rates.c_mu * rates.weights.sum()
        covariance = (
            kept * self.covariance
            + rates.c_1 * np.outer(path_c, path_c)
            + rates.c_mu * (y.T * weights) @ y
        )  # (47)
        return SearchDistribution(
            mean=self.mean + self.step * move,  # (42)
            step=step,
            # Rounding makes it asymmetric, and `eigh` reads one triangle alone.
            covariance=(covariance + covariance.T) / 2.0,
            path_sigma=path_sigma,
            path_c=path_c,
            generation=generation,
        )

    def _decompose(self) -> tuple[Array, Array]:
        """Return square roots of the eigenvalues, rising, and the axes as columns."""
        values, axes = np.linalg.eigh(self.covariance)
        return np.sqrt(np.maximum(values, values[-1] / MAX_CONDITION)), axes


def start_search(mean: Array, step: float) -> SearchDistribution:
    """Return the first distribution of a search, N(mean, step² · I)."""
    n = len(mean)
    return SearchDistribution(mean, step, np.eye(n), np.zeros(n), np.zeros(n))
