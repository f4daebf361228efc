"""Principal components of the failures: D* = (D − mu) V_k with D − mu = U S V^T (paper, PCA).

Small data are decomposed whole. Of large data the squares are summed block by block in double
precision, and V comes from their sum S²: an incremental PCA that loses nothing but directions with
less than 1e-7 of the largest spread. Only data that are wide besides are decomposed at random.
"""

from collections.abc import Iterator
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sklearn.decomposition import PCA

from eigenfail.values import Floats
from eigenfail_services.analysis.alignment import BLOCK

Array = NDArray[np.float64]
Data = Array | Floats

# The data are float32: what is smaller than their rounding is no direction of theirs.
ROUNDING = float(np.finfo(np.float32).eps)
SMALL_ENTRIES = 2_000_000
"""Of data with so many entries at most, the whole decomposition: 10,000 failures of 100 steps."""
WIDEST = 2_000
"""Columns above which large data are decomposed at random (Halko et al. 2011)."""
SEED = 0
OVERSAMPLES, POWER_ITERATIONS = 10, 7


class ComponentSpace(NamedTuple):
    """The first k principal components and the data in them.

    Attributes:
        mean: mu, shape (columns,).
        components: rows of V_k^T, shape (k, columns); the largest entry of each is positive.
        explained: share of the variance that each explains, shape (k,).
        scores: D*, shape (rows, k).
    """

    mean: Array
    components: Array
    explained: Array
    scores: Array

    def invert(self, scores: Array) -> Array:
        """Back to noise space: D* V_k^T + mu (paper, inverse transform).

        Args:
            scores: D*, shape (…, k); the answer's is (…, columns).
        """
        return scores @ self.components + self.mean


class Directions(NamedTuple):
    """The first singular vectors of D − mu, shape (k, columns), and their singular values."""

    vectors: Array
    singular: Array


def fit(data: Data, wanted: int) -> ComponentSpace:
    """The components of D, at most as many as its rows differ in directions.

    Args:
        data: D, shape (rows, columns).
        wanted: k.
    """
    mean = np.asarray(data.mean(axis=0, dtype=np.float64))
    smallest = ROUNDING * np.sqrt(sum(float(np.sum(block**2)) for block in blocks(data)))
    total = sum(float(np.sum((block - mean) ** 2)) for block in blocks(data))
    if np.sqrt(total) <= smallest:
        return without_spread(data, mean)
    found = directions(data, mean, min(wanted, *data.shape))
    kept = found.singular > smallest
    components = with_fixed_signs(found.vectors[kept])
    scores = np.concatenate([(block - mean) @ components.T for block in blocks(data)])
    return ComponentSpace(mean, components, found.singular[kept] ** 2 / total, scores)


def directions(data: Data, mean: Array, count: int) -> Directions:
    """The directions of largest variance, in the way that suits the size of the data.

    Args:
        data: D, shape (rows, columns).
        mean: mu, shape (columns,).
        count: k.
    """
    if data.size <= SMALL_ENTRIES:
        # LAPACK's fastest way (gesdd) now and then finds no end on rows that come twice.
        with suppress(np.linalg.LinAlgError):
            return decomposed(data, count, svd_solver="full")
        return accumulated(data, mean, count)
    if data.shape[1] <= WIDEST:
        return accumulated(data, mean, count)
    return decomposed(
        data,
        count,
        svd_solver="randomized",
        random_state=SEED,
        n_oversamples=OVERSAMPLES,
        iterated_power=POWER_ITERATIONS,
    )


def decomposed(data: Data, count: int, **solver: str | int) -> Directions:
    """By the singular value decomposition of scikit-learn."""
    pca = PCA(n_components=count, **solver).fit(data.astype(np.float64))
    return Directions(pca.components_, pca.singular_values_)


def accumulated(data: Data, mean: Array, count: int) -> Directions:
    """By the eigenvectors of (D − mu)^T (D − mu), whose eigenvalues are S², summed over blocks."""
    squares = np.zeros((data.shape[1], data.shape[1]))
    for block in blocks(data):
        centred = block - mean
        squares += centred.T @ centred
    values, vectors = np.linalg.eigh(squares)
    largest = slice(None, -count - 1, -1)
    return Directions(vectors.T[largest], np.sqrt(np.maximum(values[largest], 0.0)))


def blocks(data: Data) -> Iterator[Array]:
    """The rows in double precision, some at a time."""
    for first in range(0, len(data), BLOCK):
        yield data[first : first + BLOCK].astype(np.float64)


def without_spread(data: Data, mean: Array) -> ComponentSpace:
    """The space of rows that are all alike: a point."""
    rows, columns = data.shape
    return ComponentSpace(mean, np.zeros((0, columns)), np.zeros(0), np.zeros((rows, 0)))


def with_fixed_signs(components: Array) -> Array:
    """The same directions, each with its largest entry positive; of equal ones the first."""
    sizes = np.abs(components)
    largest = np.argmax(sizes >= (1.0 - ROUNDING) * sizes.max(axis=1, keepdims=True), axis=1)
    signs = np.sign(np.take_along_axis(components, largest[:, None], axis=1))
    return np.asarray(components * signs, np.float64)
