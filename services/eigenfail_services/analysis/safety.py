"""The safety measures of a campaign as a table (paper, section on safety measures)."""

from collections.abc import Iterator, Sequence

import numpy as np

from eigenfail.methods import traits_of
from eigenfail.values import (
    Campaign,
    Conflicts,
    Figure,
    MeasureTotals,
    Rate,
    Safety,
    SafetyTotals,
    Scatter,
    Unresolved,
    Violations,
)
from eigenfail.values.assessment import NEAR_MISS_TTC_S, PEAK_BRAKING_MPS2
from eigenfail.values.safety import LEVEL, FailurePoint
from eigenfail_services.statistics.comparison import rank_correlation
from eigenfail_services.statistics.intervals import rate
from eigenfail_services.statistics.tail_risk import tail_risk


def safety(
    campaign: Campaign,
    totals: SafetyTotals,
    conflicts: Conflicts,
    unresolved: Unresolved,
    level: float = LEVEL,
) -> Safety:
    """The table of a campaign, from what the store made of its completed episodes.

    Args:
        campaign: as it stands.
        totals: over its completed episodes.
        conflicts: these by class.
        unresolved: those that are no collisions only because they ended.
        level: of VaR and CVaR of severity.

    Raises:
        InvalidValue: the level is not between 0 and 1.
    """
    return Safety(
        campaign=campaign.id,
        name=campaign.spec.name,
        method=campaign.spec.method,
        completed=totals.completed,
        collisions=share(totals.failures, totals.completed),
        near_misses=share(conflicts.near_misses, totals.completed),
        conflicts=conflicts,
        ttc=_count_violations(totals.ttc, NEAR_MISS_TTC_S, totals.completed),
        drac=_count_violations(totals.drac, PEAK_BRAKING_MPS2, totals.completed),
        severity=tail_risk(totals.severities, level),
        scatter=Scatter(totals.points, len(totals.severities), _correlate(totals.points)),
        unresolved=unresolved,
        notes=tuple(_list_notes(campaign, totals, unresolved)),
    )


def share(k: int, n: int) -> Rate | None:
    """k of n with its interval; None of nothing."""
    return rate(min(k, n), n) if n else None


def _count_violations(totals: MeasureTotals, threshold: float, completed: int) -> Violations:
    """A row of the table."""
    return Violations(
        threshold=threshold,
        beyond=share(totals.violations, completed),
        n=totals.n,
        median=totals.median,
        worst=totals.worst,
    )


def _correlate(points: Sequence[FailurePoint]) -> Figure | None:
    """How severity goes with likelihood, over the points that are shown."""
    return rank_correlation(
        np.array([point.log_probability_per_step for point in points]),
        np.array([point.severity for point in points]),
    )


def _list_notes(campaign: Campaign, totals: SafetyTotals, unresolved: Unresolved) -> Iterator[str]:
    """What the numbers cannot know."""
    if words := unresolved.words(totals.completed):
        yield words
    if totals.failures and not traits_of(campaign.spec.method).draws_from_prior:
        yield (
            f"The episodes are those that {campaign.spec.method} chose: shares, medians and "
            "severities are of these, not of what p(x) would bring."
        )
    if missing := totals.failures - len(totals.severities):
        yield f"{missing} of {totals.failures} failures have no severity and are left out of it."
    if len(totals.points) < len(totals.severities):
        yield (
            f"The scatter shows {len(totals.points)} of {len(totals.severities)} failures, evenly "
            "spread in index order."
        )
