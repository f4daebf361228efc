"""Mode collapse: whether a method keeps finding the same failure.

K-means finds two or more clusters in anything, pure noise too. So clusters count as modes only
where their silhouette exceeds that of structureless data of the same size and covariance, clustered
in the same way; otherwise all failures are one mode.
"""

from math import exp, log

import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import InvalidValue
from eigenfail.values import AnalysisResult, Diversity
from eigenfail.values.diversity import COLLAPSED_SHARE, NARROW_SPREAD
from eigenfail.values.records import Failures

INTERVALS = 10
LEAST_FAILURES = 10
"""Of fewer failures no share of 90 % can be told from one of 100 %."""

REMEDY = "try `ensemble`, the reward `dissimilarity`, or a distribution of scenarios."
SAME = "One mode, or none that can be told from noise"

Labels = NDArray[np.int64]


def diversity(failures: Failures, result: AnalysisResult, episodes: int) -> Diversity:
    """How the failures of a campaign spread over the modes that an analysis found.

    Args:
        failures: those that were analysed, in the same order.
        result: what the analysis found.
        episodes: of the campaign, failures or not: what `coverage` takes tenths of.

    Raises:
        InvalidValue: there is no failure, or the analysis is one of other failures.
    """
    if not failures.indices or failures.indices != result.episodes:
        problem = "are not the ones that were analysed, or there is none."
        raise InvalidValue("failures", problem, "Analyse the campaign again.")
    labels = np.array(result.labels if result.distinct else [0] * len(result.labels))
    shares = np.bincount(labels) / len(labels)
    largest, wide = float(shares.max()), spread(failures)
    return Diversity(
        failures=len(labels),
        modes=len(shares),
        largest_share=largest,
        effective_modes=effective_modes(shares),
        spread=wide,
        coverage=coverage(labels, np.array(failures.indices), episodes),
        verdict=verdict(result, shares),
        warning=warning(len(labels), len(shares), largest, wide),
    )


def effective_modes(shares: NDArray[np.float64]) -> float:
    """exp(−sum p log p): how many equally large modes would be as diverse.

    Source: Hill 1973, Ecology 54, 427–432, order 1.
    """
    return exp(-sum(p * log(p) for p in shares.tolist() if p > 0.0))


def coverage(labels: Labels, indices: Labels, episodes: int) -> tuple[int, ...]:
    """How many of the modes had been seen after each tenth of the episodes.

    Args:
        labels: the mode of each failure, shape (failures,).
        indices: its episode, shape (failures,).
        episodes: of the campaign.
    """
    first = [int(indices[labels == mode].min()) for mode in np.unique(labels)]
    last = max(episodes, int(indices.max()) + 1)
    ends = [last * tenth / INTERVALS for tenth in range(1, INTERVALS + 1)]
    return tuple(sum(index < end for index in first) for end in ends)


def spread(failures: Failures) -> float | None:
    """How much the failures differ from each other in each step that at least two of them reach.

    Root mean square over these steps and both axes of the standard deviation (n − 1) of z. [sigma]
    None where there is no such step.
    """
    lengths = np.array([len(z) for z in failures.noise])
    noise = np.full((len(lengths), lengths.max(), 2), np.nan)
    for row, z in zip(noise, failures.noise, strict=True):
        row[: len(z)] = z
    reached = np.isfinite(noise[:, :, 0]).sum(axis=0) >= 2
    if not reached.any():
        return None
    variance = np.nanvar(noise[:, reached], axis=0, ddof=1)
    return float(np.sqrt(variance.mean()))


def verdict(result: AnalysisResult, shares: NDArray[np.float64]) -> str:
    """How many modes, and how evenly they were found, in words."""
    if not result.distinct:
        return f"{SAME}{against_noise(result)}."
    return (
        f"{len(shares)} modes{against_noise(result)}; the largest holds "
        f"{100.0 * shares.max():.0f} % of {len(result.labels)} failures. "
        f"Effective number of modes: {effective_modes(shares):.1f}."
    )


def against_noise(result: AnalysisResult) -> str:
    """The silhouette of the clusters beside that of structureless data, if there are clusters."""
    if result.silhouette is None or result.noise_silhouette is None:
        return ""
    return f" (silhouette {result.silhouette:.2f}, on noise {result.noise_silhouette:.2f})"


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
