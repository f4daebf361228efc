"""How well samples stand for others: density and coverage (Naeem et al. 2020, ICML, sec. 3).

Every real sample has a ball: up to its k-th nearest neighbour among the other real ones.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree

from eigenfail.errors import InvalidValue

Array = NDArray[np.float64]

NEIGHBOURS = 5


class SampleQuality(NamedTuple):
    """Both measures; 1 and 1 - 2^-k are expected of equally many samples of the same distribution.

    Attributes:
        density: how many balls hold a generated sample, ÷ k, on average; low where samples lie
            outside of the real ones, above 1 where they crowd.
        coverage: share of the balls that hold a generated sample; low where modes are missing.
    """

    density: float
    coverage: float


def sample_quality(
    real: ArrayLike, generated: ArrayLike, neighbours: int = NEIGHBOURS
) -> SampleQuality:
    """Density and coverage of generated samples.

    Args:
        real: samples of the truth, shape (n, dimensions), n above `neighbours`.
        generated: samples to judge, shape (m, dimensions), m at least 1.
        neighbours: k.

    Raises:
        InvalidValue: too few samples, other shapes, or numbers that are not finite.
    """
    truth, judged = _points("real", real), _points("generated", generated)
    if not (len(truth) > neighbours >= 1 and len(judged) and truth.shape[1] == judged.shape[1]):
        raise InvalidValue(
            "samples",
            f"{truth.shape} real and {judged.shape} generated ones do not fit k = {neighbours}.",
            "Give more real samples than k, one generated one, and as many dimensions in both.",
        )
    radii = KDTree(truth).query(truth, k=neighbours + 1)[0][:, -1]
    held = KDTree(judged).query_ball_point(truth, radii, return_length=True)
    return SampleQuality(float(held.sum() / (neighbours * len(judged))), float((held > 0).mean()))


def _points(name: str, samples: ArrayLike) -> Array:
    points = np.asarray(samples, np.float64)
    if points.ndim != 2 or not np.isfinite(points).all():
        raise InvalidValue(
            name,
            f"samples of shape {points.shape} are no table of finite numbers.",
            "Give one row for each sample.",
        )
    return points
