"""Principal components of the failures: D* = (D − mu) V_k with D − mu = U S V^T (paper, PCA)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sklearn.decomposition import PCA

# The data are float32: what is smaller than their rounding is no direction of theirs.
ROUNDING = float(np.finfo(np.float32).eps)


class ComponentSpace(NamedTuple):
    """The first k principal components and the data in them.

    Attributes:
        mean: mu, shape (columns,).
        components: rows of V_k^T, shape (k, columns); the largest entry of each is positive.
        explained: share of the variance that each explains, shape (k,).
        scores: D*, shape (rows, k).
    """

    mean: NDArray[np.float64]
    components: NDArray[np.float64]
    explained: NDArray[np.float64]
    scores: NDArray[np.float64]

    def invert(self, scores: NDArray[np.float64]) -> NDArray[np.float64]:
        """Back to noise space: D* V_k^T + mu (paper, inverse transform)."""
        return scores @ self.components + self.mean


def fit(data: NDArray[np.float64], wanted: int) -> ComponentSpace:
    """The components of D, at most as many as its rows differ in directions.

    Args:
        data: D, shape (rows, columns).
        wanted: k.
    """
    mean = data.mean(axis=0)
    smallest = ROUNDING * float(np.linalg.norm(data))
    if np.linalg.norm(data - mean) <= smallest:
        return without_spread(data, mean)
    pca = PCA(n_components=min(wanted, *data.shape), svd_solver="full").fit(data)
    kept = pca.singular_values_ > smallest
    components = with_fixed_signs(pca.components_[kept])
    scores = (data - mean) @ components.T
    return ComponentSpace(mean, components, pca.explained_variance_ratio_[kept], scores)


def without_spread(data: NDArray[np.float64], mean: NDArray[np.float64]) -> ComponentSpace:
    """The space of rows that are all alike: a point."""
    rows, columns = data.shape
    return ComponentSpace(mean, np.zeros((0, columns)), np.zeros(0), np.zeros((rows, 0)))


def with_fixed_signs(components: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same directions, each with its largest entry positive; of equal ones the first."""
    sizes = np.abs(components)
    largest = np.argmax(sizes >= (1.0 - ROUNDING) * sizes.max(axis=1, keepdims=True), axis=1)
    signs = np.sign(np.take_along_axis(components, largest[:, None], axis=1))
    return np.asarray(components * signs, np.float64)
