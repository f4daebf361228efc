"""Groups among the failures, and how much of a group chance alone would show.

Clustering always finds groups. Whether they are more than an artefact says the comparison with data
without groups, of the same size, spread and distances from the centre, clustered in the same way.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sklearn.metrics import silhouette_score

from eigenfail_services.analysis.clusterers import CLUSTERERS, SEED, Clusterer, Labels, Scores

KMEANS = CLUSTERERS["kmeans"]
# The largest of 19 draws is a test at the level of 1 in 20 of elliptical data.
NOISE_DRAWS = 19
# A silhouette takes all pairs: of more rows, these many drawn ones speak for all.
SILHOUETTE_ROWS = 2000
# Of more rows, these many drawn ones are clustered, and the others put with their groups.
CLUSTERED_ROWS = 5000
# Scores nearer than this share of the largest one count as equal.
RESOLUTION_DIGITS = 6


class Partition(NamedTuple):
    """Each row's group, the silhouette of the whole (None with a single group), outliers."""

    labels: Labels
    silhouette: float | None
    outliers: float = 0.0


def divide(scores: Scores, clusters: int | None, clusterer: Clusterer = KMEANS) -> Partition:
    """The rows in groups, repeatable.

    One group results where a division would say nothing: unless there are more different rows
    than groups.

    Args:
        scores: D*, shape (rows, k).
        clusters: number of groups; None takes the best silhouette.
        clusterer: what finds them.
    """
    limit = count_different(scores[drawn(len(scores), CLUSTERED_ROWS)]) - 1
    wanted = [k for k in clusterer.choices(clusters) if 2 <= k <= limit]
    tried = [split(scores, k, clusterer) for k in wanted]
    single = Partition(np.zeros(len(scores), np.intp), None)
    found = [partition for partition in tried if partition is not None]
    return max(found, key=lambda partition: partition.silhouette or 0.0, default=single)


def noise_silhouette(scores: Scores, clusters: int | None, clusterer: Clusterer = KMEANS) -> float:
    """The largest silhouette that `divide` reaches on several draws of data without groups.

    Scores of components are uncorrelated, so their spreads are all of their covariance. One
    elliptical cloud exceeds the largest of the draws in one case of twenty; one that is skewed or
    bent does so more often, without having groups.
    """
    generator = np.random.default_rng(SEED)
    draws = (without_groups(scores, generator) for _ in range(NOISE_DRAWS))
    return max(divide(noise, clusters, clusterer).silhouette or 0.0 for noise in draws)


def without_groups(scores: Scores, generator: np.random.Generator) -> Scores:
    """Rows as far from the centre as those of the scores, each in a direction of its own.

    Distances are counted in standard deviations of each component. So a shell is held against
    shells, and a blob against blobs: of a normal distribution this is another draw. Along a single
    component there are but two directions, and the draw is normal.
    """
    spread = scores.std(axis=0)
    size = (min(len(scores), SILHOUETTE_ROWS), len(spread))
    noise = generator.standard_normal(size)
    if len(spread) > 1:
        distances = np.linalg.norm((scores - scores.mean(axis=0)) / spread, axis=1)
        chosen = generator.permutation(distances)[: len(noise)]
        noise *= (chosen / np.linalg.norm(noise, axis=1))[:, None]
    return np.asarray(noise * spread, np.float64)


def split(scores: Scores, clusters: int, clusterer: Clusterer) -> Partition | None:
    """The rows in so many groups; None if fewer than two show."""
    grouping = clusterer.fit(scores[drawn(len(scores), CLUSTERED_ROWS)], clusters)
    if grouping is None:
        return None
    labels = grouping.groups.predict(scores).astype(np.intp)
    if len(np.unique(labels)) < 2:
        return None
    return Partition(labels, silhouette(scores, labels), grouping.outliers)


def silhouette(scores: Scores, labels: Labels) -> float:
    """The mean silhouette (Rousseeuw 1987); 0 where each row, or none, is a group of its own."""
    rows = drawn(len(scores), SILHOUETTE_ROWS)
    if not 1 < len(np.unique(labels[rows])) < len(rows):
        return 0.0
    return float(silhouette_score(scores[rows], labels[rows]))


def drawn(rows: int, most: int) -> NDArray[np.intp]:
    """So many of the rows at most, drawn evenly, always the same ones."""
    if rows <= most:
        return np.arange(rows)
    return np.random.default_rng(SEED).choice(rows, most, replace=False)


def count_different(scores: Scores) -> int:
    """How many of the rows differ by more than rounding."""
    largest = np.abs(scores).max(initial=0.0)
    if largest == 0.0:
        return 1
    return len(np.unique(np.round(scores / largest, RESOLUTION_DIGITS), axis=0))


def largest_first(labels: Labels, episodes: NDArray[np.int64]) -> Labels:
    """The groups numbered by size; of equal ones, that of the earliest episode comes first.

    Args:
        labels: the group of each failure, shape (failures,); the answer has the same.
        episodes: the index of each, shape (failures,).
    """
    names, sizes = np.unique(labels, return_counts=True)
    earliest = [episodes[labels == name].min() for name in names]
    order = np.lexsort((earliest, -sizes))
    return np.argsort(order)[np.searchsorted(names, labels)]
