"""Mode collapse: whether a method keeps finding the same failure.

Clustering finds groups in anything, pure noise too. So clusters count as modes only where the
analysis calls them distinct; otherwise all failures are one mode.
"""

from collections.abc import Mapping
from math import exp, log

import numpy as np
from numpy.typing import NDArray

from eigenfail.values import AnalysisResult, Diversity
from eigenfail.values.diversity import COLLAPSED_SHARE, NARROW_SPREAD
from eigenfail_services.analysis.alignment import Aligned
from eigenfail_services.analysis.training import INTERVALS, tenth_of

LEAST_FAILURES = 10
"""Of fewer failures no share of 90 % can be told from one of 100 %."""

REMEDY = "try `ensemble`, the reward `dissimilarity`, or a distribution of scenarios."

Labels = NDArray[np.int64]


def diversity(failures: Aligned, result: AnalysisResult, episodes: Mapping[int, int]) -> Diversity:
    """How the failures of campaigns spread over the modes that an analysis found.

    Args:
        failures: those that were analysed.
        result: what the analysis found.
        episodes: how many of each campaign have ended, by its id: `coverage` takes tenths of that.
    """
    labels = np.array(result.labels if result.distinct else [0] * len(result.labels))
    shares = np.bincount(labels) / len(labels)
    largest, wide = float(shares.max()), spread(failures)
    return Diversity(
        failures=len(labels),
        modes=len(shares),
        largest_share=largest,
        effective_modes=effective_modes(shares),
        spread=wide,
        coverage=coverage(labels, tenth_of(failures, episodes)[failures.order]),
        verdict=verdict(result, shares),
        warning=warning(len(labels), len(shares), largest, wide),
    )


def effective_modes(shares: NDArray[np.float64]) -> float:
    """exp(−sum p log p): how many equally large modes would be as diverse.

    Args:
        shares: p, of the failures, shape (modes,).

    Source: Hill 1973, Ecology 54, 427–432, order 1.
    """
    return exp(-sum(p * log(p) for p in shares.tolist() if p > 0.0))


def coverage(labels: Labels, tenths: Labels) -> tuple[int, ...]:
    """How many of the modes had been seen after each tenth of the episodes.

    Args:
        labels: the mode of each failure, shape (failures,).
        tenths: in which tenth of its campaign it was found, from 0, shape (failures,).
    """
    first = [int(tenths[labels == mode].min()) for mode in np.unique(labels)]
    return tuple(sum(seen <= tenth for seen in first) for tenth in range(INTERVALS))


def spread(failures: Aligned) -> float | None:
    """How much the failures differ from each other in each step that at least two of them reach.

    Root mean square over these steps and both axes of the standard deviation (n − 1) of z. [sigma]
    None where there is no such step.
    """
    reached = np.zeros((failures.horizon, 1))
    sums, squares = (np.zeros((failures.horizon, 2)) for _ in range(2))
    for noise in failures.runs():
        reached[: noise.shape[1]] += len(noise)
        sums[: noise.shape[1]] += noise.sum(axis=0)
    twice = reached[:, 0] >= 2
    if not twice.any():
        return None
    means = sums / np.maximum(reached, 1.0)
    for noise in failures.runs():
        squares[: noise.shape[1]] += ((noise - means[: noise.shape[1]]) ** 2).sum(axis=0)
    return float(np.sqrt(np.mean(squares[twice] / (reached[twice] - 1.0))))


def verdict(result: AnalysisResult, shares: NDArray[np.float64]) -> str:
    """How many modes, and how evenly they were found, in words."""
    if not result.distinct:
        return result.verdict
    return (
        f"{result.verdict} The largest holds {100.0 * shares.max():.0f} % of "
        f"{len(result.labels)} failures. Effective number of modes: {effective_modes(shares):.1f}."
    )


def warning(failures: int, modes: int, largest: float, wide: float | None) -> str:
    """That the modes have collapsed, and what to try; nothing said of a few failures.

    A single mode is no collapse by itself: a planner may have no second. It is one where the
    failures hardly differ, for noise that makes a planner fail leaves most of itself free.
    """
    if failures < LEAST_FAILURES:
        return ""
    if modes > 1 and largest > COLLAPSED_SHARE:
        return f"mode collapse: {100.0 * largest:.0f} % of the failures are of one mode; {REMEDY}"
    if modes == 1 and wide is not None and wide < NARROW_SPREAD:
        return f"mode collapse: the failures differ by {wide:.2f} sigma only; {REMEDY}"
    return ""
