"""The best use of the next episodes: the division that reduces the variance of a total most.

The total T = Σ λ_s P_s has the variance Σ λ_s² σ_s² ÷ n_s + Σ P_s² Var(λ_s). Here σ_s² is the
variance of one episode. For Monte Carlo, σ_s² = P (1 - P). For any other estimate, whose error
falls with the square root of its budget, σ_s² is n_s times the squared standard error. Only the
first sum depends on episodes. With m_s more of them, m_s ≥ 0 and Σ m_s fixed, it is smallest where

    n_s + m_s = c · λ_s σ_s    or    m_s = 0 and n_s above that,

with one c for all scenarios: Neyman's allocation (Neyman 1934, J. R. Stat. Soc. 97, 558–606;
Cochran 1977, *Sampling Techniques*, 5.5), with a part of the budget spent already. λ_s and P_s are
set to plausible values above 0. Without a failure P_s is 1 ÷ (2 (n + 1)), so that a scenario
without failures so far gets episodes.

σ_s is unknown for a scenario without an estimate. Each such scenario first gets an equal part of
the budget, 1 ÷ number of all scenarios, for a first estimate. The rest is divided as above. If
there are fewer episodes than such scenarios, each gets one as long as episodes last. Episodes
cannot reduce the second sum; if it is the larger one, more hours of driving help more.
"""

from collections.abc import Mapping, Sequence
from math import floor, sqrt

import msgspec

from eigenfail_assurance.risk.confidence import RiskTerm


class EpisodeShare(msgspec.Struct, frozen=True, kw_only=True):
    """The part of the next budget for a scenario.

    Attributes:
        scenario: its name.
        episodes: number of episodes.
        now: standard error that its probability of failure leaves in the total; None without an
            estimate. [1/h]
        then: predicted value of `now` after these episodes. [1/h]
    """

    scenario: str
    episodes: int
    now: float | None
    then: float | None


class Allocation(msgspec.Struct, frozen=True, kw_only=True):
    """The best use of the next episodes.

    Attributes:
        episodes: their number.
        shares: what each scenario should get, in the order of the question.
        now: standard error of the total. [1/h]
        then: predicted standard error of the total after these episodes. [1/h]
        exposure: share of today's variance that is due to exposure, which no episode reduces; None
            if the variance is 0.
    """

    episodes: int
    shares: tuple[EpisodeShare, ...]
    now: float
    then: float
    exposure: float | None


def allocate_episodes(names: Sequence[str], terms: Sequence[RiskTerm], episodes: int) -> Allocation:
    """Return the allocation that leaves the smallest variance of the total.

    Args:
        names: all scenarios in order.
        terms: terms of the scenarios that have an estimate.
        episodes: the budget.
    """
    known = {term.name: term for term in terms}
    unknown = [name for name in names if name not in known]
    pilots = max(episodes // len(names) * len(unknown), min(episodes, len(unknown)))
    if not terms:
        pilots = episodes
    equal = _round_to_sum([pilots / max(len(unknown), 1)] * len(unknown), pilots)
    more = dict(zip(unknown, equal, strict=True))
    if terms:
        more |= _divide(terms, episodes - pilots)
    shares = tuple(_make_share(name, known.get(name), more[name]) for name in names)
    exposure = sum(term.probability.centre**2 * term.exposure.variance for term in terms)
    now = sum((each.now or 0.0) ** 2 for each in shares) + exposure
    then = sum((each.then or 0.0) ** 2 for each in shares) + exposure
    return Allocation(
        episodes=episodes,
        shares=shares,
        now=sqrt(now),
        then=sqrt(then),
        exposure=exposure / now if now else None,
    )


def _make_share(name: str, term: RiskTerm | None, episodes: int) -> EpisodeShare:
    if term is None:
        return EpisodeShare(scenario=name, episodes=episodes, now=None, then=None)
    now = term.exposure.centre * sqrt(term.probability.variance)
    then = now * sqrt(term.episodes / (term.episodes + episodes))
    return EpisodeShare(scenario=name, episodes=episodes, now=now, then=then)


def _divide(terms: Sequence[RiskTerm], episodes: int) -> Mapping[str, int]:
    """Return the episodes of each term, by Neyman's allocation."""
    weights = [
        term.exposure.centre * sqrt(term.probability.variance * term.episodes) for term in terms
    ]
    if not any(weights):
        weights = [1.0] * len(terms)
    spent = [term.episodes for term in terms]
    factor = _find_factor(weights, spent, episodes)
    wanted = [
        max(factor * weight - before, 0.0) for weight, before in zip(weights, spent, strict=True)
    ]
    given = _round_to_sum(wanted, episodes)
    return {term.name: each for term, each in zip(terms, given, strict=True)}


def _find_factor(weights: Sequence[float], spent: Sequence[int], episodes: int) -> float:
    """Return the c at which Σ max(c · weight - spent, 0) is the number of episodes."""
    joining = sorted(
        (before / weight, weight, before)
        for weight, before in zip(weights, spent, strict=True)
        if weight
    )
    weight_sum, spent_sum, factor = 0.0, 0, 0.0
    for place, (_, weight, before) in enumerate(joining):
        weight_sum, spent_sum = weight_sum + weight, spent_sum + before
        factor = (episodes + spent_sum) / weight_sum
        if place + 1 == len(joining) or factor <= joining[place + 1][0]:
            break
    return factor


def _round_to_sum(wanted: Sequence[float], total: int) -> list[int]:
    """Return integers next to numbers, with this sum: the largest remainders are rounded up."""
    given = [floor(each) for each in wanted]
    by_remainder = sorted(range(len(wanted)), key=lambda at: given[at] - wanted[at])
    for at in by_remainder[: max(total - sum(given), 0)]:
        given[at] += 1
    return given
