"""The estimate of one subset simulation, from its levels' samples and their lineages."""

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
        threshold: largest robustness that a sample on the level may have.
        share: probability of reaching the level, given the level before.
        acceptance: share of accepted moves on the level before; 1 on the first level.
    """

    threshold: float
    share: float
    acceptance: float


class SubsetEstimate(msgspec.Struct, frozen=True, kw_only=True):
    """The result of one run.

    Attributes:
        draws: number of independent first draws, equal to the number of samples on a level.
        probability: probability of a failure; None if none was reached.
        cv: coefficient of variation of `probability`; 0 without a probability.
        effective_first_draws: effective number of independent first draws that the failures descend
            from; 0 without failures.
        interval: 95 % interval, log-normal around `probability`; None without a probability. It
            does not cover kinds of failure that no sample came near.
        distinct_first_draws: number of independent first draws that the failures descend from.
        trajectories_run: number of trajectories with known robustness.
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
    """Return the level at a threshold, with the share of the previous samples that reach it.

    In the share of the first level, errored draws count as not reaching it. So the product of the
    shares is the probability that noise can be run and fails.
    """
    share = float((chains.values <= threshold).mean()) * chains.ran
    return SubsetLevel(threshold, share, chains.acceptance)


def count_effective(weights: NDArray[np.number]) -> float:
    """Return the effective number of weighted draws: (sum w)² ÷ sum w² (Kish 1965).

    Args:
        weights: weight of each draw, such as its number of descending failures; not all zero.
    """
    return float(weights.sum() ** 2 / np.square(weights).sum())


def estimate_cv(effective: float, draws: int, levels: int) -> float:
    """Return the coefficient of variation of a product of shares over fixed levels.

    With n first draws, 1 − (1 − 1 / effective) · (n / (n − 1))^levels is an unbiased estimate of
    its square (Lee and Whiteley 2018, equation 9). With one level, it is the binomial coefficient
    of variation.
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
    """Return the estimate of a run that did not reach failures."""
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
