"""The estimate of one subset simulation, from the samples of its levels and their lineages."""

from collections.abc import Sequence
from enum import StrEnum
from math import prod, sqrt

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.values.estimates import Interval
from eigenfail_services.statistics.conditional_sampler import Chains
from eigenfail_services.statistics.intervals import log_normal


class SubsetEnd(StrEnum):
    """Why a subset simulation ended."""

    REACHED = "failures were reached"
    STALLED = "robustness falls no further"
    SPENT = "all levels were spent"
    MISSED = "no sample reached the next level"
    CUT = "the other runs need the episodes that are left"


class SubsetLevel(msgspec.Struct, frozen=True):
    """One level.

    Attributes:
        threshold: robustness at or below which a sample is on it.
        share: probability of that, given the level before.
        acceptance: share of the moves that were accepted on the level before; 1 on the first.
    """

    threshold: float
    share: float
    acceptance: float


class SubsetEstimate(msgspec.Struct, frozen=True, kw_only=True):
    """The result of one run.

    Attributes:
        draws: number of independent first draws, which is that of the samples on a level.
        probability: probability of a failure; None if none was reached.
        cv: coefficient of variation of that product; 0 without it.
        effective_first_draws: effective number of independent first draws from which the failures
            descend; 0 without failures.
        interval: 95 %, log-normal around `probability`; None without it. It knows nothing of a kind
            of failure of which no sample showed the beginning.
        distinct_first_draws: number of independent first draws from which the failures descend.
        trajectories_run: trajectories whose robustness is known.
    """

    draws: int
    probability: float | None
    cv: float
    effective_first_draws: float
    interval: Interval | None
    distinct_first_draws: int
    trajectories_run: int
    levels: tuple[SubsetLevel, ...]
    end: SubsetEnd


def make_level(chains: Chains, threshold: float) -> SubsetLevel:
    """Return the level at a threshold, and the share of the samples before that reaches it.

    Draws that errored count in the share of the first level, as none that reaches it: the product
    of the shares is then the probability of a failure of noise that can be run.
    """
    share = float((chains.values <= threshold).mean()) * chains.ran
    return SubsetLevel(threshold, share, chains.acceptance)


def count_effective(weights: NDArray[np.number]) -> float:
    """Return the effective number of weighted draws: (sum w)² ÷ sum w² (Kish 1965).

    Args:
        weights: weight of each draw, such as the failures that descend from it; not all zero.
    """
    return float(weights.sum() ** 2 / np.square(weights).sum())


def estimate_cv(effective: float, draws: int, levels: int) -> float:
    """Return the coefficient of variation of a product of shares over fixed levels.

    1 − (1 − 1 / effective) · (n / (n − 1))^levels is an unbiased estimate of its square, with n
    first draws (Lee and Whiteley 2018, equation 9). With one level it is the binomial one.
    """
    kept = (1.0 - 1.0 / effective) * (draws / (draws - 1.0)) ** levels
    # The estimate of the square may be negative by chance.
    return sqrt(max(1.0 - kept, 0.0))


def estimate_from_failures(
    levels: Sequence[SubsetLevel], chains: Chains, draws: int, trajectories_run: int
) -> SubsetEstimate:
    """Return the estimate of a run that reached failures, with its log-normal interval."""
    failures = (chains.values <= 0.0).sum(axis=0)
    # Samples of one lineage depend on each other; lineages are nearly independent.
    descendants = np.bincount(chains.first_draw_of_chain, failures)
    probability = prod(one.share for one in levels)
    effective = count_effective(descendants)
    cv = estimate_cv(effective, draws, len(levels))
    return SubsetEstimate(
        draws=draws,
        probability=probability,
        cv=cv,
        effective_first_draws=effective,
        interval=log_normal(probability, cv, effective),
        distinct_first_draws=int(np.count_nonzero(descendants)),
        trajectories_run=trajectories_run,
        levels=tuple(levels),
        end=SubsetEnd.REACHED,
    )


def estimate_without_failures(
    levels: Sequence[SubsetLevel], end: SubsetEnd, draws: int, trajectories_run: int
) -> SubsetEstimate:
    """Return the estimate of a run that reached no failure."""
    return SubsetEstimate(
        draws=draws,
        probability=None,
        cv=0.0,
        effective_first_draws=0.0,
        interval=None,
        distinct_first_draws=0,
        trajectories_run=trajectories_run,
        levels=tuple(levels),
        end=end,
    )
