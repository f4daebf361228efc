"""Clusters of failures, with their separation and their stability under resampling.

Clustering always finds groups. To show that they are more than an artefact, they are compared with
clusters of data without groups. These data have the same size, spread and distances from the
centre, and are clustered in the same way.
"""

import warnings
from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from sklearn.cluster import HDBSCAN, KMeans
from sklearn.exceptions import ConvergenceWarning
from sklearn.metrics import adjusted_rand_score, pairwise_distances, silhouette_score
from sklearn.mixture import GaussianMixture
from sklearn.neighbors import KNeighborsClassifier

from eigenfail.values.analysis import AnalysisSettings, Stability
from eigenfail.values.arrays import Floats
from eigenfail.values.estimates import Interval
from eigenfail_services.analysis.components import fit_components

Scores = NDArray[np.float64]
Labels = NDArray[np.intp]

CHOICES = range(2, 9)
SEED = 0
STARTS = 3
SMALLEST_SHARE = 0.05
FEWEST = 5


class Groups(Protocol):
    """Groups that were found in some rows."""

    def predict(self, scores: Scores) -> Labels:
        """Return the group of each row, shape (rows,)."""


class Grouping(NamedTuple):
    """Groups, and the share of the rows that belong to no group."""

    groups: Groups
    outliers: float = 0.0


class Clusterer(Protocol):
    """A repeatable way to find groups."""

    def choices(self, wanted: int | None) -> Sequence[int]:
        """Return the numbers of groups to try; the best silhouette is taken."""

    def fit(self, scores: Scores, groups: int) -> Grouping | None:
        """Return groups of rows, with at least as many different rows as groups; None if not found.

        Args:
            scores: shape (rows, components).
            groups: number of groups to find.
        """


class ScaledGroups(NamedTuple):
    """Groups that were found in rows divided by a scale."""

    groups: Groups
    scale: float

    def predict(self, scores: Scores) -> Labels:
        """Return the group of each row, shape (rows,)."""
        return self.groups.predict(scores / self.scale)


class KMeansClusterer:
    """Round groups, all of about one width (Lloyd 1982); several seeded starts."""

    def choices(self, wanted: int | None) -> Sequence[int]:
        """Return the wanted number, or 2 to 8."""
        return CHOICES if wanted is None else (wanted,)

    def fit(self, scores: Scores, groups: int) -> Grouping:
        """Return the groups with the smallest sum of squared distances from their means."""
        means = KMeans(
            groups, init="k-means++", n_init=STARTS, random_state=SEED, algorithm="lloyd"
        )
        return Grouping(means.fit(scores))


class MixtureClusterer:
    """A mixture of normal distributions with full covariances: groups of different widths."""

    def choices(self, wanted: int | None) -> Sequence[int]:
        """Return the wanted number, or 2 to 8."""
        return CHOICES if wanted is None else (wanted,)

    def fit(self, scores: Scores, groups: int) -> Grouping:
        """Return the most likely mixture that is reached from a K-means start."""
        # What keeps covariances regular is an absolute number: it is to mean the same at any scale.
        scale = float(scores.std())
        mixture = GaussianMixture(groups, covariance_type="full", random_state=SEED)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)
            return Grouping(ScaledGroups(mixture.fit(scores / scale), scale))


class DensityClusterer:
    """Dense regions of any form and number (Campello et al. 2013).

    A region counts if it holds at least 5 % of the rows, and at least 5 rows. A row outside all
    regions joins its nearest neighbour inside a region, so that every failure has a mode. Such rows
    are counted as outliers.
    """

    def choices(self, _wanted: int | None) -> Sequence[int]:
        """Return a single number: the clusterer finds the number of groups itself."""
        return CHOICES[:1]

    def fit(self, scores: Scores, _groups: int) -> Grouping | None:
        """Return the dense regions; None if there are fewer than two."""
        size = max(FEWEST, round(SMALLEST_SHARE * len(scores)))
        if len(scores) < 2 * size:
            return None
        labels = HDBSCAN(min_cluster_size=size, copy=True).fit_predict(scores)
        inside = labels >= 0
        if len(np.unique(labels[inside])) < 2:
            return None
        nearest = KNeighborsClassifier(1).fit(scores[inside], labels[inside])
        return Grouping(nearest, 1.0 - float(inside.mean()))


CLUSTERERS: dict[str, Clusterer] = {
    "kmeans": KMeansClusterer(),
    "hdbscan": DensityClusterer(),
    "gaussian_mixture": MixtureClusterer(),
}


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
    """Each row's group, the mean silhouette (None with a single group), the share of outliers."""

    labels: Labels
    silhouette: float | None
    outliers: float = 0.0


def divide(
    scores: Scores,
    clusters: int | None,
    clusterer: Clusterer = KMEANS,
    resolution: float = 0.0,
) -> Partition:
    """Divide rows into groups; the same rows always give the same groups.

    The result is a single group if a division would be meaningless. That is the case without more
    different rows than groups (or, with a resolution, at least as many), or if all groups are
    nearer to each other than the resolution.

    Args:
        scores: D*, shape (rows, k).
        clusters: number of groups; with None, the number with the best silhouette.
        clusterer: method that finds the groups.
        resolution: distance below which rows count as equal; see `_compute_silhouette`.
    """
    found = _find_partition(scores, clusters, clusterer, resolution)
    if found.silhouette is None:
        return found
    centres = [scores[found.labels == label].mean(axis=0) for label in np.unique(found.labels)]
    is_one = float(pairwise_distances(centres).max()) < resolution
    return _join(scores) if is_one else found


def _find_partition(
    scores: Scores, clusters: int | None, clusterer: Clusterer, resolution: float
) -> Partition:
    """Return the partition with the best silhouette, even if its groups are close."""
    rows = draw_rows(len(scores), CLUSTERED_ROWS)
    limit = _count_different(scores[rows])
    # Noise differs in every failure, so that a group for each different row has no content.
    # Behaviour may be exactly equal: each course is a group, unless a single failure has it.
    limit = min(limit, len(rows) - 1) if resolution > 0.0 else limit - 1
    wanted = [k for k in clusterer.choices(clusters) if 2 <= k <= limit]
    tried = [_split(scores, k, clusterer, resolution) for k in wanted]
    found = [partition for partition in tried if partition is not None]
    return max(found, key=lambda partition: partition.silhouette or 0.0, default=_join(scores))


def _join(scores: Scores) -> Partition:
    return Partition(np.zeros(len(scores), np.intp), None)


def compute_noise_silhouette(
    scores: Scores,
    clusters: int | None,
    clusterer: Clusterer = KMEANS,
    resolution: float = 0.0,
) -> float:
    """Return the largest silhouette over several draws of data without groups.

    Scores of components are uncorrelated, so their spreads determine their covariance. A single
    elliptical cloud exceeds the largest draw in one case of twenty. A skewed or bent cloud exceeds
    it more often, also without groups.
    """
    # Seeded, so that an analysis that is repeated has the same digest.
    generator = np.random.default_rng(SEED)
    draws = (draw_without_groups(scores, generator) for _ in range(NOISE_DRAWS))
    found = (_find_partition(noise, clusters, clusterer, resolution) for noise in draws)
    return max(partition.silhouette or 0.0 for partition in found)


def draw_without_groups(scores: Scores, generator: np.random.Generator) -> Scores:
    """Draw rows with the norms of the scores and uniformly random directions.

    Distances are counted in standard deviations of each component. So a shell is compared with
    shells, and a blob with blobs; for a normal distribution the result is another draw from it. A
    single component has only two directions, so its draw is normal.
    """
    spread = scores.std(axis=0)
    size = (min(len(scores), SILHOUETTE_ROWS), len(spread))
    noise = generator.standard_normal(size)
    if len(spread) > 1:
        distances = np.linalg.norm((scores - scores.mean(axis=0)) / spread, axis=1)
        chosen = generator.permutation(distances)[: len(noise)]
        noise *= (chosen / np.linalg.norm(noise, axis=1))[:, None]
    return np.asarray(noise * spread, np.float64)


def _split(
    scores: Scores, clusters: int, clusterer: Clusterer, resolution: float
) -> Partition | None:
    """Return the labels of k groups; None if fewer than two are non-empty."""
    grouping = clusterer.fit(scores[draw_rows(len(scores), CLUSTERED_ROWS)], clusters)
    if grouping is None:
        return None
    labels = grouping.groups.predict(scores).astype(np.intp)
    if len(np.unique(labels)) < 2:
        return None
    silhouette = _compute_silhouette(scores, labels, resolution)
    return Partition(labels, silhouette, grouping.outliers)


def _compute_silhouette(scores: Scores, labels: Labels, resolution: float = 0.0) -> float:
    """Return the mean silhouette (Rousseeuw 1987); 0 for a single group, or one per row.

    A distance d between two rows counts as √(d² + r²) with the resolution r. Without it, nearly
    equal rows, which are frequent with a deterministic planner, would each be a group.
    """
    rows = draw_rows(len(scores), SILHOUETTE_ROWS)
    if not 1 < len(np.unique(labels[rows])) < len(rows):
        return 0.0
    if resolution == 0.0:
        return float(silhouette_score(scores[rows], labels[rows]))
    distances = np.hypot(pairwise_distances(scores[rows]), resolution)
    np.fill_diagonal(distances, 0.0)
    return float(silhouette_score(distances, labels[rows], metric="precomputed"))


def draw_rows(rows: int, most: int) -> NDArray[np.intp]:
    """Return at most `most` rows, sampled evenly with a fixed seed."""
    if rows <= most:
        return np.arange(rows)
    return np.random.default_rng(SEED).choice(rows, most, replace=False)


def _count_different(scores: Scores) -> int:
    """Return the number of rows that differ by more than rounding."""
    largest = np.abs(scores).max(initial=0.0)
    if largest == 0.0:
        return 1
    return len(np.unique(np.round(scores / largest, RESOLUTION_DIGITS), axis=0))


def order_by_size(labels: Labels, episodes: NDArray[np.int64]) -> Labels:
    """Number the groups by size; among equal sizes, the group with the earliest episode is first.

    Args:
        labels: the group of each failure, shape (failures,), like the result.
        episodes: the index of each failure's episode, shape (failures,).
    """
    names, sizes = np.unique(labels, return_counts=True)
    earliest = [episodes[labels == name].min() for name in names]
    # The last key of `lexsort` counts first.
    order = np.lexsort((earliest, -sizes))
    return np.argsort(order)[np.searchsorted(names, labels)]


# Of more failures, this many are drawn: modes that are stable with few are stable with many.
ROWS = 2000


def measure_stability(
    data: Floats, labels: Labels, settings: AnalysisSettings, resolution: float = 0.0
) -> Stability | None:
    """Return the adjusted Rand index under the bootstrap (Efron 1979; Hubert and Arabie 1985).

    Each draw is analysed from the start: components, the number of modes unless it is given, modes.
    The failures of a draw, each counted once, are compared by their new and their original modes.

    Args:
        data: D, shape (failures, columns).
        labels: the mode of each failure, shape (failures,).
        settings: settings of the analysis.
        resolution: as in `divide`.

    Returns:
        None if there is a single mode, or if no resamples are set.
    """
    if settings.bootstrap == 0 or len(np.unique(labels)) < 2:
        return None
    rows = draw_rows(len(data), ROWS)
    generator = np.random.default_rng(SEED)
    found = [
        _measure_likeness(data, labels, generator.choice(rows, len(rows)), settings, resolution)
        for _ in range(settings.bootstrap)
    ]
    low, median, high = np.quantile(found, (0.025, 0.5, 0.975)).tolist()
    return Stability(settings.bootstrap, len(rows), median, Interval(low, high))


def _measure_likeness(
    data: Floats,
    labels: Labels,
    resample: Labels,
    settings: AnalysisSettings,
    resolution: float,
) -> float:
    """Return the adjusted Rand index between new and original modes of a draw's failures."""
    space = fit_components(data[resample], settings.components)
    clusterer = CLUSTERERS[settings.clusterer]
    again = divide(space.scores, settings.clusters, clusterer, resolution)
    # A row that was drawn twice would agree with itself.
    rows, first = np.unique(resample, return_index=True)
    return float(adjusted_rand_score(labels[rows], again.labels[first]))
