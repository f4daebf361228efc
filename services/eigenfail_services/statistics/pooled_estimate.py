"""One failure probability from independent estimates or independent subset simulations.

A simulation misses kinds of failures that none of its first draws leads to, and its own interval
cannot show this. Two simulations miss different kinds. If they disagree by more than their
intervals allow, no number is given.
"""

from collections.abc import Sequence
from itertools import combinations
from math import fsum, hypot, inf, log, log1p, prod, sqrt
from statistics import stdev

from eigenfail.intervals import ERROR, find_upper_bound
from eigenfail.values.estimates import BY_MONTE_CARLO, Estimate, Interval
from eigenfail_services.statistics import intervals, subset_estimate, subset_simulation

# Of one side: 99.9 % of the differences of two estimates that agree are smaller.
DISAGREEMENT = 0.9995
"""Quantile of the difference of two estimates beyond which they disagree."""


def pool_estimates(estimates: Sequence[Estimate]) -> Estimate:
    """Return the mean of independent estimates, each weighted by its episodes.

    Weights by the estimates' own variances would favour small estimates: if failures are rare, an
    estimate that is too low also has too small a variance. The interval is log-normal around the
    mean, as in subset simulation. If an estimate lacks a coefficient of variation, or if the mean
    is 0, the interval is missing. The mean of lower bounds is a lower bound without an interval:
    their agreement proves nothing, since all may miss the same failures.

    Args:
        estimates: at least one. If one estimate lacks a number, so does the result.
    """
    episodes = sum(one.episodes for one in estimates)
    for number, one in enumerate(estimates):
        if one.probability is None:
            problem = f"Member {number}: {one.problem}"
            return Estimate(by=one.by, episodes=episodes, problem=problem)
    known = [
        # An estimate that names no effective number has a variation that is known, not
        # estimated.
        (one.probability, one.cv, one.effective or inf)
        for one in estimates
        if one.probability and one.cv is not None
    ]
    if disagree(known):
        probabilities = ", ".join(f"{one.probability:.1e}" for one in estimates)
        problem = (
            f"The members disagree: {probabilities}. Each knows other failures; take method subset."
        )
        return Estimate(by=estimates[0].by, episodes=episodes, problem=problem)
    found = [one.probability or 0.0 for one in estimates]
    weights = [one.episodes / episodes for one in estimates]
    probability = sum(p * weight for p, weight in zip(found, weights, strict=True))
    cv = combine_cvs(found, weights, [one.cv for one in estimates])
    bounded = any(one.bound for one in estimates)
    effective = _sum_known([one.effective for one in estimates])
    return Estimate(
        by=estimates[0].by,
        episodes=episodes,
        probability=probability,
        cv=cv,
        interval=None
        if cv is None or bounded
        else intervals.log_normal(probability, cv, effective or inf),
        effective=effective,
        note=" ".join(dict.fromkeys(one.note for one in estimates if one.note)),
        bound="lower" if bounded else None,
    )


def disagree(found: Sequence[tuple[float, float, float]]) -> bool:
    """Return whether two estimates lie further apart than 99.9 % of pairs with their variations.

    Args:
        found: for each estimate, the probability (above 0), its coefficient of variation, and the
            effective number of samples behind the coefficient (infinite if it is known).
    """
    logs = [(log(p), log1p(cv**2), effective) for p, cv, effective in found]
    return any(
        abs(a - b)
        > intervals.find_quantile(DISAGREEMENT, min(worth_a, worth_b)) * sqrt(of_a + of_b)
        for (a, of_a, worth_a), (b, of_b, worth_b) in combinations(logs, 2)
    )


def combine_cvs(
    found: Sequence[float], weights: Sequence[float], cvs: Sequence[float | None]
) -> float | None:
    """Return the coefficient of variation of a weighted mean of independent estimates.

    It is the larger of two values: from the estimates' own variations, and from their distance to
    each other.
    """
    known = [cv for cv in cvs if cv is not None]
    mean = sum(p * weight for p, weight in zip(found, weights, strict=True))
    if len(known) < len(found) or not mean:
        return None
    own = hypot(*(p * weight * cv for p, weight, cv in zip(found, weights, known, strict=True)))
    # The error of the weighted mean if each member has the variance that all of them show.
    apart = stdev(found) * hypot(*weights) if len(found) > 1 else 0.0
    return max(own, apart) / mean


def _sum_known(sizes: Sequence[float | None]) -> float | None:
    known = [size for size in sizes if size is not None]
    return sum(known) if len(known) == len(sizes) else None


SUBSET_SIMULATION = "subset simulation"

FEW_SAMPLES = 2000
"""On each level; with no more, on a world with rare lineages, the truth was missed 300-fold."""

MOST_BESIDE_NONE = 10.0
"""Effective number of first draws of a run beside which another one may well miss all failures."""

WIDEST_INTERVAL = 1e4
"""Upper end ÷ lower end beyond which a number needs to be confirmed by wide noise. Such intervals
hold the truth, but the numbers in them need not be near it: where two kinds of failure compete
(`metaballs` of the known problems), half of those printed were below a hundredth of it."""

NEAR = 5.0
"""Ratio of the estimate from wide noise to that of the levels within which it confirms it."""

FAR_ABOVE = 2.0
"""Multiple of the upper end of an interval beyond which wide noise contradicts it, by its estimate
without the largest weight. On the known problems, with 100 draws or 500, that reached twice the
truth in three of a hundred cases at most."""

MORE = "Give it more episodes."
BLIND = "It does not include failure types that no sample came near."


def pool_simulations(
    found: Sequence[subset_estimate.SubsetEstimate],
    episodes: int,
    wide: subset_simulation.WideEstimate | None = None,
) -> Estimate:
    """Return the pooled estimate of ended runs over the same levels.

    The share of each level pools the samples of all runs, with each run weighted by its first
    draws. If runs differ much, the product of pooled shares has a smaller error than the mean of
    the runs' products. Its variation is estimated by the variation of this mean.

    Args:
        found: result of each run, at least one; the run that chose the levels comes first.
        episodes: number of episodes of all runs.
        wide: estimate of the same probability from wide noise; None without it.
    """
    reached = [one for one in found if one.probability is not None]
    if not reached:
        deepest = min(found, key=lambda one: _multiply_shares(one.levels))
        return refuse_estimate(episodes, _describe_miss(deepest.end, deepest.levels))
    missed = len(reached) < len(found)
    cvs = _find_cvs(found)
    known = [
        (one.probability, cv, one.effective_first_draws)
        for one, cv in zip(found, cvs, strict=True)
        if one.probability is not None
    ]
    most = max(one.effective_first_draws for one in reached)
    if disagree(known) or (missed and most > MOST_BESIDE_NONE):
        return refuse_estimate(episodes, _describe_disagreement(found))
    # A run without a failure counts as 0: without it, the mean would be too large on average.
    probabilities = [one.probability or 0.0 for one in found]
    draws = sum(one.draws for one in found)
    cv = combine_cvs(probabilities, [one.draws / draws for one in found], cvs) or 0.0
    probability = _multiply_pooled_shares(found)
    effective = sum(one.effective_first_draws for one in found)
    interval = intervals.log_normal(probability, cv, effective)
    if problem := _describe_doubt(probability, interval, effective, wide):
        return refuse_estimate(episodes, problem)
    return Estimate(
        by=SUBSET_SIMULATION,
        episodes=episodes,
        probability=probability,
        cv=cv,
        interval=interval,
        effective=effective,
        note=_list_doubts(len(found), max(one.draws for one in found)),
    )


def _describe_doubt(
    probability: float,
    interval: Interval,
    effective: float,
    wide: subset_simulation.WideEstimate | None,
) -> str:
    """Return why a pooled estimate is not stated; empty if it is stated.

    Args:
        probability: pooled estimate.
        interval: its interval.
        effective: effective number of first draws.
        wide: estimate of the same probability from wide noise; None without it.
    """
    if wide and wide.without_largest > FAR_ABOVE * interval.high:
        return (
            "Wider noise meets failures that the levels passed by: P is about "
            f"{wide.probability:.0e} by these and {probability:.0e} by the levels. "
            "Take method mixture."
        )
    is_confirmed = wide and probability / NEAR <= wide.probability <= probability * NEAR
    if interval.high > WIDEST_INTERVAL * interval.low and not is_confirmed:
        return (
            f"Its failures are worth {effective:.1f} independent first draws: a 95 % interval would"
            f" reach from {interval.low:.0e} to {interval.high:.0e}. {MORE}"
        )
    return ""


def _multiply_pooled_shares(found: Sequence[subset_estimate.SubsetEstimate]) -> float:
    """Return the product of the levels' shares, each pooled over the samples of all runs."""
    shares = []
    for number in range(max(len(one.levels) for one in found)):
        # A run that died out has a share of 0 at its last level, and no samples below that.
        there = [one for one in found if number < len(one.levels)]
        reached = fsum(one.draws * one.levels[number].share for one in there)
        shares.append(reached / sum(one.draws for one in there))
    return prod(shares)


def _find_cvs(found: Sequence[subset_estimate.SubsetEstimate]) -> list[float]:
    """Return the coefficient of variation of each run.

    The lineages of the first run hide a part of its error, since it chose its levels itself. So its
    coefficient is at least as large as for later runs with the same number of first draws.
    """
    first, *others = found
    of_others = [one.cv * sqrt(one.draws / first.draws) for one in others]
    return [max(first.cv, *of_others, 0.0), *(one.cv for one in others)]


def _describe_disagreement(found: Sequence[subset_estimate.SubsetEstimate]) -> str:
    figures = [
        "none" if one.probability is None else f"{one.probability:.1e}"
        for one in sorted(found, key=lambda one: one.probability or 0.0)
    ]
    return (
        f"The independent runs disagree: {', '.join(figures)}. A run that misses a kind of failure "
        f"finds too little, so that the largest is likelier to be right. {MORE}"
    )


def _list_doubts(runs: int, samples: int) -> str:
    few = (
        f" {samples} samples on a level are few: repeat it with another seed, or with enough "
        f"episodes for more than {FEW_SAMPLES}."
    )
    lonely = " There is no second run to compare it with."
    return BLIND + few * (samples <= FEW_SAMPLES) + lonely * (runs == 1)


ALL_ERRORED = "Every episode errored: correct what raised."
"""More episodes would error as well."""


def estimate_unfinished(
    simulation: subset_simulation.SubsetSimulation, spent: bool
) -> Estimate | None:
    """Return the estimate of an unfinished simulation; None before its first level.

    Args:
        simulation: simulation in its present state.
        spent: whether the budget is spent.
    """
    episodes, levels = simulation.trajectories_run, simulation.first.levels
    if spent and not episodes:
        return refuse_estimate(episodes, ALL_ERRORED)
    if spent:
        ended = "the second run" if simulation.runs else "the first level"
        return refuse_estimate(episodes, f"The budget ended before {ended} did. {MORE}")
    if simulation.runs:
        return refuse_estimate(episodes, "Not known yet. The first run has reached failures.")
    if levels:
        return refuse_estimate(episodes, f"Not known yet. {_describe_depth(levels)}")
    return None


def estimate_ended(simulation: subset_simulation.SubsetSimulation) -> Estimate:
    """Return the estimate of an ended simulation."""
    found = [one.result for one in simulation.runs if one.result is not None]
    if not found:
        return _explain_missing_runs(simulation)
    wide = simulation.wide.estimate if simulation.wide else None
    return pool_simulations(found, simulation.trajectories_run, wide)


def _explain_missing_runs(simulation: subset_simulation.SubsetSimulation) -> Estimate:
    """Return the estimate, with the reason, of a simulation that ended with its first run.

    If plain draws followed, it is their estimate.
    """
    first, end = simulation.first, simulation.end
    fewer = f" Set samples to {max(first.draws // 2, subset_simulation.FEWEST_SAMPLES)}." * (
        end is subset_estimate.SubsetEnd.CUT
    )
    problem = f"{_describe_miss(end, first.levels)}{fewer}"
    refused = refuse_estimate(simulation.trajectories_run, problem)
    counts = simulation.plain.counts if simulation.plain else None
    return estimate_from_draws(refused, counts) if counts else refused


def estimate_from_draws(refused: Estimate, counts: subset_simulation.PlainCounts) -> Estimate:
    """Return the estimate of plain draws that followed a refusal, with its reason.

    Errored draws count as not failed in the estimate, and as failures in the upper end.

    Args:
        refused: estimate without a number.
        counts: draws from p(z) whose number was fixed beforehand.
    """
    draws, failures, errored = counts
    episodes = refused.episodes + draws - errored
    what = f"{draws} episodes that were left, drawn from the disturbance model"
    lost = f" {errored} of these errored, and count as failures in the bound." if errored else ""
    if not failures:
        problem = (
            f"{refused.problem} None of the {what}, failed: P is at most "
            f"{find_upper_bound(errored, draws, ERROR):.1e} with 95 % confidence.{lost}"
        )
        return Estimate(by=refused.by, episodes=episodes, problem=problem)
    share = failures / draws
    return Estimate(
        by=BY_MONTE_CARLO,
        episodes=episodes,
        probability=share,
        # Binomial: sqrt(p · (1 − p) ÷ n) ÷ p.
        cv=sqrt((1.0 - share) / failures),
        interval=intervals.bound_stated_share(failures, draws, failures + errored),
        note=f"The share of failures among the {what}.{lost} {refused.by.capitalize()} gave no "
        f"number. {refused.problem}",
    )


def _describe_miss(
    end: subset_estimate.SubsetEnd | None, levels: Sequence[subset_estimate.SubsetLevel]
) -> str:
    return (
        f"No failure was reached: {end}. {_describe_depth(levels)} "
        "That says nothing of failures of which no sample came near."
    )


def _describe_depth(levels: Sequence[subset_estimate.SubsetLevel]) -> str:
    reached = [one for one in levels if one.share > 0.0]
    if not reached:
        return "No intermediate level was reached."
    return (
        f"Robustness is {reached[-1].threshold:.3g} m or less with a probability of about "
        f"{_multiply_shares(reached):.1e}."
    )


def _multiply_shares(levels: Sequence[subset_estimate.SubsetLevel]) -> float:
    return prod(one.share for one in levels)


def refuse_estimate(episodes: int, problem: str) -> Estimate:
    """Return an estimate without a number, and the reason."""
    return Estimate(by=SUBSET_SIMULATION, episodes=episodes, problem=problem)
