"""Principal components of the failures: D* = (D − mu) V_k with D − mu = U S V^T (paper, PCA).

Small data are decomposed as a whole. For large data, the squares are summed block by block in
double precision, and V comes from their sum S². This incremental PCA loses only directions with
less than 1e-7 of the largest spread. Large data that are also wide are decomposed at random.
"""

from collections.abc import Iterator
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray
from sklearn.decomposition import PCA

from eigenfail.values.analysis import Centre, FailureMode
from eigenfail.values.arrays import Floats
from eigenfail_services.analysis.alignment import BLOCK, Aligned, median_steps

Array = NDArray[np.float64]
Data = Array | Floats

# The data are float32: a component smaller than their rounding is no direction of theirs.
ROUNDING = float(np.finfo(np.float32).eps)
SMALL_ENTRIES = 2_000_000
"""Maximum number of entries for a full decomposition: 10,000 failures of 100 steps."""
WIDEST = 2_000
"""Columns above which large data are decomposed at random (Halko et al. 2011)."""
SEED = 0
OVERSAMPLES, POWER_ITERATIONS = 10, 7


class ComponentSpace(NamedTuple):
    """The first k principal components and the data in them.

    Attributes:
        mean: mu, shape (columns,).
        components: rows of V_k^T, shape (k, columns); the largest entry of each row is positive.
        explained: share of the variance that each component explains, shape (k,).
        scores: D*, shape (rows, k).
    """

    mean: Array
    components: Array
    explained: Array
    scores: Array

    def invert(self, scores: Array) -> Array:
        """Transform scores back to noise space: D* V_k^T + mu (paper, inverse transform).

        Args:
            scores: D*, shape (…, k); the result has shape (…, columns).
        """
        return scores @ self.components + self.mean


class Directions(NamedTuple):
    """The first singular vectors of D − mu, shape (k, columns), and their singular values."""

    vectors: Array
    singular: Array


def fit_components(data: Data, wanted: int) -> ComponentSpace:
    """Return the components of D, at most as many as its rows span directions.

    Args:
        data: D, shape (rows, columns).
        wanted: k.
    """
    mean = np.asarray(data.mean(axis=0, dtype=np.float64))
    smallest = ROUNDING * np.sqrt(sum(float(np.sum(block**2)) for block in iterate_blocks(data)))
    total = sum(float(np.sum((block - mean) ** 2)) for block in iterate_blocks(data))
    if np.sqrt(total) <= smallest:
        # Rows that are all alike span no direction: their space is a point.
        rows, columns = data.shape
        return ComponentSpace(mean, np.zeros((0, columns)), np.zeros(0), np.zeros((rows, 0)))
    found = _find_directions(data, mean, min(wanted, *data.shape))
    kept = found.singular > smallest
    components = fix_signs(found.vectors[kept])
    scores = np.concatenate([(block - mean) @ components.T for block in iterate_blocks(data)])
    return ComponentSpace(mean, components, found.singular[kept] ** 2 / total, scores)


def _find_directions(data: Data, mean: Array, count: int) -> Directions:
    """Return the directions of largest variance, with a solver that suits the size of the data.

    Args:
        data: D, shape (rows, columns).
        mean: mu, shape (columns,).
        count: k.
    """
    if data.size <= SMALL_ENTRIES:
        # LAPACK's fastest way (gesdd) now and then finds no end on rows that come twice.
        with suppress(np.linalg.LinAlgError):
            return _decompose(data, count, svd_solver="full")
        return _accumulate(data, mean, count)
    if data.shape[1] <= WIDEST:
        return _accumulate(data, mean, count)
    return _decompose(
        data,
        count,
        svd_solver="randomized",
        random_state=SEED,
        n_oversamples=OVERSAMPLES,
        iterated_power=POWER_ITERATIONS,
    )


def _decompose(data: Data, count: int, **solver: str | int) -> Directions:
    """Return the directions from scikit-learn's singular value decomposition."""
    pca = PCA(n_components=count, **solver).fit(data.astype(np.float64))
    return Directions(pca.components_, pca.singular_values_)


def _accumulate(data: Data, mean: Array, count: int) -> Directions:
    """Return the directions from the eigenvectors of (D − mu)^T (D − mu), summed over blocks."""
    squares = np.zeros((data.shape[1], data.shape[1]))
    for block in iterate_blocks(data):
        centred = block - mean
        squares += centred.T @ centred
    values, vectors = np.linalg.eigh(squares)
    # `eigh` returns the smallest eigenvalue first.
    largest = slice(None, -count - 1, -1)
    # Rounding may leave an eigenvalue of 0 a little below it.
    return Directions(vectors.T[largest], np.sqrt(np.maximum(values[largest], 0.0)))


def iterate_blocks(data: Data) -> Iterator[Array]:
    """Yield the rows in double precision, in blocks."""
    for first in range(0, len(data), BLOCK):
        yield data[first : first + BLOCK].astype(np.float64)


def fix_signs(components: Array) -> Array:
    """Return directions whose largest entry (the first of equal ones) is positive."""
    sizes = np.abs(components)
    # Entries that differ by rounding alone are equal, or the processor would choose the sign.
    largest = np.argmax(sizes >= (1.0 - ROUNDING) * sizes.max(axis=1, keepdims=True), axis=1)
    signs = np.sign(np.take_along_axis(components, largest[:, None], axis=1))
    return np.asarray(components * signs, np.float64)


QUANTILES = (0.1, 0.5, 0.9)
"""Of the noise of a mode at each step: its band, with the median between."""


class Spaces(NamedTuple):
    """The components of the noise, and of the features for grouping failures.

    If failures are grouped by their noise, both are the same object.
    """

    noise: ComponentSpace
    features: ComponentSpace


def describe_modes(
    failures: Aligned, spaces: Spaces, labels: NDArray[np.intp], centre: Centre
) -> tuple[FailureMode, ...]:
    """Return one mode for each label, in the order of the labels."""
    groups = (np.flatnonzero(labels == label) for label in range(labels.max() + 1))
    return tuple(_describe_mode(failures, spaces, members, centre) for members in groups)


def _describe_mode(
    failures: Aligned, spaces: Spaces, members: NDArray[np.intp], kind: Centre
) -> FailureMode:
    """Return the mode of some failures: centre, failure nearest to it, and eigenfailure.

    The eigenfailure of kind `mean` is centre · V_k^T + mu (paper, inverse transform). For kind
    `median`, it is the median of the noise at each step. Both are moved back to the start. A few
    atypical failures move a mean, which may then fail nowhere, but hardly move a median.

    Args:
        failures: all of them.
        spaces: spaces of the rows.
        members: rows of the mode's failures, shape (members,).
        kind: centre that the eigenfailure shows.
    """
    centre = spaces.noise.scores[members].mean(axis=0)
    scores = spaces.features.scores[members]
    nearest = members[np.argmin(np.linalg.norm(scores - scores.mean(axis=0), axis=1))]
    low, median, high = _compute_quantiles(failures, members)
    means = failures.injectable(_select_noise(centre, failures, spaces.noise, members), members)
    eigenfailure = median if kind == "median" else means
    mode = FailureMode(
        failures=len(members),
        medoid=int(failures.episodes[nearest]),
        centre=centre.astype(np.float32),
        eigenfailure=eigenfailure.astype(np.float32),
        medoid_campaign=int(failures.campaigns[nearest]),
        band=np.stack([low, high]).astype(np.float32),
        # Failures may end before their first step; a peak needs at least one step.
        lasting=max(1, median_steps(failures.steps[members].tolist())),
    )
    if spaces.features is spaces.noise:
        return mode
    own = fit_components(failures.data[members], len(spaces.noise.components))
    return replace(
        mode,
        components=failures.by_step(own.components).astype(np.float32),
        explained=own.explained.astype(np.float32),
    )


def _compute_quantiles(failures: Aligned, members: NDArray[np.intp]) -> list[Array]:
    """Return the quantiles of the members' noise at each step.

    Each quantile has the shape (horizon, channels), and covers the failures that lasted until the
    step. The result is moved back to the start, and zero at steps that no failure reached.
    """
    lasted = np.zeros((len(members), failures.horizon), np.bool_)
    for row, steps in zip(lasted, failures.steps[members].tolist(), strict=True):
        row[failures.alignment.place(steps, failures.horizon)] = True
    found = np.zeros((len(QUANTILES), failures.horizon, len(failures.channels)))
    for step in np.flatnonzero(lasted.any(axis=0)):
        there = members[lasted[:, step]]
        noise = failures.noise[there, step].astype(np.float64)
        found[:, step] = np.quantile(noise, QUANTILES, axis=0)
    return [failures.injectable(each, members) for each in found]


def _select_noise(
    centre: NDArray[np.float64],
    failures: Aligned,
    space: ComponentSpace,
    members: NDArray[np.intp],
) -> NDArray[np.float64]:
    """Return the noise of a centre, shape (horizon, channels); left-out channels hold their mean.

    The channels together make a planner fail: without noise in one channel it might not fail.
    """
    noise = np.asarray(failures.noise[members].mean(axis=0, dtype=np.float64))
    noise[:, failures.columns] = space.invert(centre).reshape(failures.horizon, -1)
    return noise


def measure_influence(
    components: NDArray[np.float64], explained: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the weight of each step and channel: sum over k of explained_k · |V_k|.

    Args:
        components: shape (k, steps, channels).
        explained: share of the variance of each component, shape (k,).

    Returns:
        Shape (steps, channels), in the alignment of the components; zeros without components.
    """
    return np.tensordot(explained, np.abs(components), axes=1)
