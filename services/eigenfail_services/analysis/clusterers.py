"""What finds groups among scores: scikit-learn's, each as an object of one protocol."""

import warnings
from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from sklearn.cluster import HDBSCAN, KMeans
from sklearn.exceptions import ConvergenceWarning
from sklearn.mixture import GaussianMixture
from sklearn.neighbors import KNeighborsClassifier

Scores = NDArray[np.float64]
Labels = NDArray[np.intp]

CHOICES = range(2, 9)
SEED = 0
STARTS = 3
SMALLEST_SHARE = 0.05
FEWEST = 5


class Groups(Protocol):
    """Groups that were found among some rows."""

    def predict(self, scores: Scores) -> Labels:
        """The group of each row, shape (rows,)."""


class Grouping(NamedTuple):
    """Groups, and the share of the rows that were found to belong to none."""

    groups: Groups
    outliers: float = 0.0


class Clusterer(Protocol):
    """A way to find groups, repeatable."""

    def choices(self, wanted: int | None) -> Sequence[int]:
        """The numbers of groups to try; the best silhouette decides."""

    def fit(self, scores: Scores, groups: int) -> Grouping | None:
        """Groups among rows that differ more often than there are groups; None if none show.

        Args:
            scores: shape (rows, components).
            groups: how many to find.
        """


class ScaledGroups(NamedTuple):
    """Groups that were found among rows divided by a scale."""

    groups: Groups
    scale: float

    def predict(self, scores: Scores) -> Labels:
        """The group of each row, shape (rows,)."""
        return self.groups.predict(scores / self.scale)


class KMeansClusterer:
    """Round groups, all of about one width (Lloyd 1982); several seeded starts."""

    def choices(self, wanted: int | None) -> Sequence[int]:
        """As wanted, or 2 to 8."""
        return CHOICES if wanted is None else (wanted,)

    def fit(self, scores: Scores, groups: int) -> Grouping:
        """The partition of least squares."""
        means = KMeans(
            groups, init="k-means++", n_init=STARTS, random_state=SEED, algorithm="lloyd"
        )
        return Grouping(means.fit(scores))


class MixtureClusterer:
    """Normal distributions, each with a covariance of its own: groups of different widths."""

    def choices(self, wanted: int | None) -> Sequence[int]:
        """As wanted, or 2 to 8."""
        return CHOICES if wanted is None else (wanted,)

    def fit(self, scores: Scores, groups: int) -> Grouping:
        """The mixture of largest likelihood that the start of K-means leads to."""
        # What keeps covariances regular is an absolute number: it is to mean the same at any scale.
        scale = float(scores.std())
        mixture = GaussianMixture(groups, covariance_type="full", random_state=SEED)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)
            return Grouping(ScaledGroups(mixture.fit(scores / scale), scale))


class DensityClusterer:
    """Dense regions of any form and number (Campello et al. 2013).

    A region counts from 5 % of the rows on, and at least 5. Rows that belong to none are put with
    their nearest neighbour that does, so that every failure has its mode, and are told of.
    """

    def choices(self, _wanted: int | None) -> Sequence[int]:
        """It finds the number itself; two groups are the fewest."""
        return CHOICES[:1]

    def fit(self, scores: Scores, _groups: int) -> Grouping | None:
        """The regions, if there are at least two."""
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
