"""Change of failures during training (paper, figure of the disturbances), and mode collapse.

Clustering finds groups in anything, even in pure noise. Clusters count as modes only if the
analysis calls them distinct; otherwise all failures are one mode.
"""

from collections.abc import Mapping
from math import exp, log

import numpy as np
from numpy.typing import NDArray

from eigenfail.values import analysis
from eigenfail_services.analysis.alignment import Aligned
from eigenfail_services.analysis.components import ComponentSpace, fit_components, iterate_blocks

TENTHS = 10
SHOWN_COMPONENTS = 3


def summarize_training(
    failures: Aligned, space: ComponentSpace, episodes: Mapping[int, int]
) -> tuple[analysis.TrainingInterval, ...]:
    """Return ten intervals of the episodes, with mean and components of each one's failures.

    Args:
        failures: failures of one or several campaigns.
        space: the components of all failures.
        episodes: number of ended episodes of each campaign, by its id.
    """
    tenths = find_tenths(failures, episodes)
    return tuple(
        _summarize_interval(failures, space, tenth, np.flatnonzero(tenths == tenth))
        for tenth in range(TENTHS)
    )


def find_tenths(failures: Aligned, episodes: Mapping[int, int]) -> NDArray[np.int64]:
    """Return the tenth of its campaign that each failure falls in, from 0, shape (failures,)."""
    tenths = np.zeros(len(failures.episodes), np.int64)
    for campaign in np.unique(failures.campaigns).tolist():
        own = failures.campaigns == campaign
        indices = failures.episodes[own]
        # Counts and failures may have been read a few results apart.
        last = max(episodes.get(campaign, 0), int(indices.max()) + 1)
        tenths[own] = indices * TENTHS // last
    return tenths


def _summarize_interval(
    failures: Aligned, space: ComponentSpace, tenth: int, rows: NDArray[np.intp]
) -> analysis.TrainingInterval:
    """Return a training interval with the failures in `rows`."""
    own = failures._replace(noise=failures.noise[rows])
    mean = np.zeros((failures.horizon, len(failures.channels)))
    for block in iterate_blocks(own.noise):
        mean += block.sum(axis=0) / len(rows)
    wanted = min(SHOWN_COMPONENTS, len(space.components))
    found = fit_components(own.data, wanted) if len(rows) > 1 and wanted else None
    components = found.components if found else space.components[:0]
    cosines = np.sum(components * space.components[: len(components)], axis=1)
    # The sign of a component is arbitrary: that of the whole makes intervals comparable.
    turned = components * np.where(cosines < 0.0, -1.0, 1.0)[:, None]
    return analysis.TrainingInterval(
        start=tenth / TENTHS,
        end=(tenth + 1) / TENTHS,
        failures=len(rows),
        mean=mean.astype(np.float32),
        components=failures.by_step(turned).astype(np.float32),
        explained=(found.explained if found else np.zeros(0)).astype(np.float32),
        likeness=np.abs(cosines).astype(np.float32),
    )


LEAST_FAILURES = 10
"""With fewer failures a share of 90 % cannot be distinguished from one of 100 %."""

REMEDY = "try `ensemble`, the reward `dissimilarity`, or a distribution of scenarios."

Labels = NDArray[np.int64]


def measure_diversity(
    failures: Aligned, result: analysis.AnalysisResult, episodes: Mapping[int, int]
) -> analysis.Diversity:
    """Return how the failures of campaigns spread over the modes of an analysis.

    Args:
        failures: analysed failures.
        result: result of the analysis.
        episodes: number of ended episodes of each campaign, by its id, for `count_coverage`.
    """
    labels = np.array(result.labels if result.distinct else [0] * len(result.labels))
    shares = np.bincount(labels) / len(labels)
    largest, wide = float(shares.max()), measure_spread(failures)
    return analysis.Diversity(
        failures=len(labels),
        modes=len(shares),
        largest_share=largest,
        effective_modes=count_effective_modes(shares),
        spread=wide,
        coverage=count_coverage(labels, find_tenths(failures, episodes)[failures.order]),
        verdict=describe_collapse(result, shares),
        warning=_write_warning(len(labels), len(shares), largest, wide),
    )


def count_effective_modes(shares: NDArray[np.float64]) -> float:
    """Return the number of equally large modes with the same diversity: exp(−sum p log p).

    Args:
        shares: p, share of the failures in each mode, shape (modes,).

    Source: Hill 1973, Ecology 54, 427–432, order 1.
    """
    return exp(-sum(p * log(p) for p in shares.tolist() if p > 0.0))


def count_coverage(labels: Labels, tenths: Labels) -> tuple[int, ...]:
    """Return the number of modes that were seen after each tenth of the episodes.

    Args:
        labels: the mode of each failure, shape (failures,).
        tenths: tenth of its campaign that each failure falls in, from 0, shape (failures,).
    """
    first = [int(tenths[labels == mode].min()) for mode in np.unique(labels)]
    return tuple(sum(seen <= tenth for seen in first) for tenth in range(TENTHS))


def measure_spread(failures: Aligned) -> float | None:
    """Return the spread of the failures' noise over steps that at least two failures reach.

    Root mean square over these steps and all channels of the standard deviation (n − 1) of z; None
    if such steps do not exist. [sigma]
    """
    reached = np.zeros((failures.horizon, 1))
    # In two passes, as the difference of a mean square and a squared mean loses digits.
    sums, squares = (np.zeros((failures.horizon, len(failures.channels))) for _ in range(2))
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


def describe_collapse(result: analysis.AnalysisResult, shares: NDArray[np.float64]) -> str:
    """Return the number of modes, and how evenly they were found, in words."""
    if not result.distinct:
        return result.verdict
    return (
        f"{result.verdict} The largest holds {100.0 * shares.max():.0f} % of "
        f"{len(result.labels)} failures. "
        f"Effective number of modes: {count_effective_modes(shares):.1f}."
    )


def _write_warning(failures: int, modes: int, largest: float, wide: float | None) -> str:
    """Return a warning of mode collapse with a remedy; empty without collapse or for few failures.

    A single mode alone is not a collapse: a planner may have only one. It is a collapse if the
    failures hardly differ, because most of the noise that makes a planner fail is free to vary.

    The digests of stored results depend on these words, which must therefore not change. People
    read `Diversity.collapse` instead.
    """
    if failures < LEAST_FAILURES:
        return ""
    if modes > 1 and largest > analysis.COLLAPSED_SHARE:
        return f"mode collapse: {100.0 * largest:.0f} % of the failures are of one mode; {REMEDY}"
    if modes == 1 and wide is not None and wide < analysis.NARROW_SPREAD:
        return f"mode collapse: the failures differ by {wide:.2f} sigma only; {REMEDY}"
    return ""
