"""One failure probability from independent estimates of it."""

from collections.abc import Sequence
from itertools import combinations
from math import hypot, log, log1p, sqrt
from statistics import NormalDist, stdev

from eigenfail.values import Estimate
from eigenfail_services.statistics.intervals import log_normal

LARGEST_DEVIATION = NormalDist().inv_cdf(0.9995)


def pooled(estimates: Sequence[Estimate]) -> Estimate:
    """The mean of independent estimates, each weighted by its episodes.

    Weights by the estimates' own variances would favour the small ones: where failures are rare, an
    estimate that is too low comes with too small a variance. The interval is log-normal around the
    mean, as that of subset simulation; an estimate of 0 or without a variation leaves it open.

    Args:
        estimates: at least one. Where one of them has no number, neither has the whole.
    """
    episodes = sum(one.episodes for one in estimates)
    for number, one in enumerate(estimates):
        if one.probability is None:
            problem = f"Member {number}: {one.problem}"
            return Estimate(by=one.by, episodes=episodes, problem=problem)
    if disagree([(e.probability, e.cv) for e in estimates if e.probability and e.cv is not None]):
        told = ", ".join(f"{one.probability:.1e}" for one in estimates)
        problem = f"The members disagree: {told}. Each knows other failures; take method subset."
        return Estimate(by=estimates[0].by, episodes=episodes, problem=problem)
    found = [one.probability or 0.0 for one in estimates]
    weights = [one.episodes / episodes for one in estimates]
    probability = sum(p * weight for p, weight in zip(found, weights, strict=True))
    cv = variation(found, weights, [one.cv for one in estimates])
    return Estimate(
        by=estimates[0].by,
        episodes=episodes,
        probability=probability,
        cv=cv,
        interval=None if cv is None else log_normal(probability, cv),
        effective=total([one.effective for one in estimates]),
        note=" ".join(dict.fromkeys(one.note for one in estimates if one.note)),
    )


def disagree(found: Sequence[tuple[float, float]]) -> bool:
    """Whether two of them lie further apart than 99.9 % of pairs with their own variations.

    Args:
        found: probability, above 0, and coefficient of variation of each.
    """
    logs = [(log(probability), log1p(cv**2)) for probability, cv in found]
    return any(
        abs(a - b) > LARGEST_DEVIATION * sqrt(variance_a + variance_b)
        for (a, variance_a), (b, variance_b) in combinations(logs, 2)
    )


def variation(
    found: Sequence[float], weights: Sequence[float], cvs: Sequence[float | None]
) -> float | None:
    """Coefficient of variation of a weighted mean of independent estimates.

    The larger of what they say of themselves and of how far they lie apart.
    """
    known = [cv for cv in cvs if cv is not None]
    mean = sum(p * weight for p, weight in zip(found, weights, strict=True))
    if len(known) < len(found) or not mean:
        return None
    own = hypot(*(p * weight * cv for p, weight, cv in zip(found, weights, known, strict=True)))
    apart = stdev(found) * hypot(*weights) if len(found) > 1 else 0.0
    return max(own, apart) / mean


def total(sizes: Sequence[float | None]) -> float | None:
    """The sum, if all are known."""
    known = [size for size in sizes if size is not None]
    return sum(known) if len(known) == len(sizes) else None
