"""One estimate from independent subset simulations, and what to doubt about it.

A simulation misses the kinds of failures that none of its first draws leads to, and its own
interval cannot show that. Two of them miss different kinds: where they disagree by more than each
allows for, no number is given.
"""

from collections.abc import Sequence
from math import prod

import numpy as np

from eigenfail.values import Estimate
from eigenfail_services.statistics.intervals import log_normal
from eigenfail_services.statistics.pooled_estimate import disagree, variation
from eigenfail_services.statistics.subset_estimate import Level, SubsetEstimate

BY = "subset simulation"

FEW_SAMPLES = 2000
"""On each level; with no more, on a world with rare lineages, the truth was missed 300-fold."""

MORE = "Give it more episodes."
BLIND = "It knows nothing of a kind of failure of which no sample showed the beginning."


def pooled(found: Sequence[SubsetEstimate], samples: int) -> Estimate:
    """The estimate of simulations that have all ended.

    Args:
        found: what each of them found; at least one.
        samples: on each level of each.
    """
    episodes = sum(one.evaluations for one in found)
    reached = [one.probability for one in found if one.probability is not None]
    if not reached:
        deepest = min(found, key=lambda one: rarity(one.levels))
        return refused(episodes, f"No failure was reached: {deepest.end}. {depth(deepest.levels)}")
    cvs = [one.variation for one in found]
    if len(reached) < len(found) or disagree(list(zip(reached, cvs, strict=True))):
        return refused(episodes, disagreement(found))
    probability, even = float(np.mean(reached)), [1.0 / len(found)] * len(found)
    cv = variation(reached, even, cvs) or 0.0
    return Estimate(
        by=BY,
        episodes=episodes,
        probability=probability,
        cv=cv,
        interval=log_normal(probability, cv),
        note=doubts(len(found), samples),
    )


def disagreement(found: Sequence[SubsetEstimate]) -> str:
    """What each of them found."""
    figures = [
        "none" if one.probability is None else f"{one.probability:.1e}"
        for one in sorted(found, key=lambda one: one.probability or 0.0)
    ]
    return (
        f"The independent runs disagree: {', '.join(figures)}. A run that misses a kind of failure "
        f"finds too little, so that the largest is likelier to be right. {MORE}"
    )


def doubts(runs: int, samples: int) -> str:
    """What no interval can show."""
    few = (
        f" {samples} samples on a level are few: repeat it with another seed, or with enough "
        f"episodes for more than {FEW_SAMPLES}."
    )
    lonely = " There is no second run to compare it with."
    return BLIND + few * (samples <= FEW_SAMPLES) + lonely * (runs == 1)


def underway(levels: Sequence[Sequence[Level]], episodes: int, spent: bool) -> Estimate | None:
    """What simulations that have not all ended can say; None before any has a level.

    Args:
        levels: of each simulation.
        episodes: how many were run.
        spent: whether there will be no more.
    """
    deepest = min(levels, key=rarity)
    if not deepest:
        return refused(episodes, f"Not one level was finished. {MORE}") if spent else None
    if spent:
        return refused(episodes, f"The budget ended before failures did. {depth(deepest)} {MORE}")
    return refused(episodes, f"Not known yet. {depth(deepest)}")


def depth(levels: Sequence[Level]) -> str:
    """How far down the levels lead."""
    if not levels:
        return "There was no level to go down to."
    return (
        f"Robustness falls to {levels[-1].threshold:.3g} m with a probability of about "
        f"{rarity(levels):.1e}; failures are rarer."
    )


def rarity(levels: Sequence[Level]) -> float:
    """The probability of the last level."""
    return prod(one.share for one in levels)


def refused(episodes: int, problem: str) -> Estimate:
    """No number, and why."""
    return Estimate(by=BY, episodes=episodes, problem=problem)
