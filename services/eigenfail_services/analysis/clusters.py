"""Groups among the failures, and how much of a group chance alone would show.

K-means always finds groups. Whether they are more than an artefact says the comparison with
structureless data of the same size and spread, clustered in the same way.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sklearn.cluster import KMeans
from sklearn.metrics import silhouette_score

Scores = NDArray[np.float64]
Labels = NDArray[np.intp]

CHOICES = range(2, 9)
SEED = 0
STARTS = 5
# The largest of 19 draws is a test at the level of 1 in 20.
NOISE_DRAWS = 19
# A silhouette takes all pairs: of more rows, these many drawn ones speak for all.
SILHOUETTE_ROWS = 2000
# Scores nearer than this share of the largest one count as equal.
RESOLUTION_DIGITS = 6


class Partition(NamedTuple):
    """Each row's group, and the silhouette of the whole; None with a single group."""

    labels: Labels
    silhouette: float | None


def divide(scores: Scores, clusters: int | None) -> Partition:
    """The rows in groups by K-means, seeded and repeatable.

    One group results where a division would say nothing: unless there are more different rows
    than groups.

    Args:
        scores: D*, shape (rows, k).
        clusters: number of groups; None tries `CHOICES` and takes the best silhouette.
    """
    limit = count_different(scores) - 1
    wanted = CHOICES if clusters is None else (clusters,)
    found = [split(scores, k) for k in wanted if 2 <= k <= limit]
    single = Partition(np.zeros(len(scores), np.intp), None)
    return max(found, key=lambda partition: partition.silhouette or 0.0, default=single)


def noise_silhouette(scores: Scores, clusters: int | None) -> float:
    """The silhouette that `divide` can reach on Gaussian noise of the same covariance.

    Scores of components are uncorrelated, so their spreads are all of their covariance. The largest
    of several draws counts: groups that are none exceed it in one case of twenty.
    """
    generator = np.random.default_rng(SEED)
    spread = scores.std(axis=0)
    size = (min(len(scores), SILHOUETTE_ROWS), len(spread))
    draws = (generator.standard_normal(size) * spread for _ in range(NOISE_DRAWS))
    return max(divide(noise, clusters).silhouette or 0.0 for noise in draws)


def split(scores: Scores, clusters: int) -> Partition:
    """The rows in so many groups."""
    means = KMeans(clusters, init="k-means++", n_init=STARTS, random_state=SEED, algorithm="lloyd")
    labels = means.fit_predict(scores).astype(np.intp)
    return Partition(labels, silhouette(scores, labels))


def silhouette(scores: Scores, labels: Labels) -> float:
    """The mean silhouette (Rousseeuw 1987); 0 where each row, or none, is a group of its own."""
    rows = np.arange(len(scores))
    if len(rows) > SILHOUETTE_ROWS:
        rows = np.random.default_rng(SEED).choice(rows, SILHOUETTE_ROWS, replace=False)
    if not 1 < len(np.unique(labels[rows])) < len(rows):
        return 0.0
    return float(silhouette_score(scores[rows], labels[rows]))


def count_different(scores: Scores) -> int:
    """How many of the rows differ by more than rounding."""
    largest = np.abs(scores).max(initial=0.0)
    if largest == 0.0:
        return 1
    return len(np.unique(np.round(scores / largest, RESOLUTION_DIGITS), axis=0))


def largest_first(labels: Labels, episodes: NDArray[np.int64]) -> Labels:
    """The groups numbered by size; of equal ones, that of the earliest episode comes first."""
    names, sizes = np.unique(labels, return_counts=True)
    earliest = [episodes[labels == name].min() for name in names]
    order = np.lexsort((earliest, -sizes))
    return np.argsort(order)[np.searchsorted(names, labels)]
