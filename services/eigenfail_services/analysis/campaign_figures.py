"""Figures over a campaign's episodes: learning curve, cost of failures, safety measures."""

from collections.abc import Iterator, Sequence
from math import ceil
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from eigenfail.errors import InvalidValue
from eigenfail.methods import traits_of
from eigenfail.values import safety, summary
from eigenfail.values.campaign import Campaign, Counts
from eigenfail.values.estimates import Cost, Interval, Rate
from eigenfail.values.records import NEAR_MISS_TTC_S
from eigenfail.values.scene import PEAK_BRAKING_MPS2
from eigenfail.worlds import world_of
from eigenfail_services.analysis.sampling_design import SamplingDesign
from eigenfail_services.statistics.comparison import rank_correlation
from eigenfail_services.statistics.tail_risk import tail_risk

BLOCK_LENGTH = 100
FEWEST_BLOCKS = 10
MOST_BLOCKS_SHOWN = 50


def make_course(
    campaign: Campaign, per: int, totals: Sequence[summary.BlockTotals]
) -> summary.Course:
    """Return the course of failures, likelihood and robustness over the episodes.

    Args:
        campaign: campaign in its present state.
        per: number of indices in a block.
        totals: totals of the blocks that have a completed episode.
    """
    learns = traits_of(campaign.spec.method).learns
    return summary.Course(
        campaign=campaign.id,
        method=campaign.spec.method,
        heading="Learning curve" if learns else "Failures over episodes",
        per=per,
        blocks=tuple(_make_block(each, per, campaign) for each in totals),
    )


def _make_block(totals: summary.BlockTotals, per: int, campaign: Campaign) -> summary.CourseBlock:
    """Return a block; the last block of a campaign may be shorter."""
    steps = totals.steps
    return summary.CourseBlock(
        first=totals.first,
        last=min(totals.first + per, campaign.counts.planned) - 1,
        failure_rate=SamplingDesign.of([campaign.spec]).make_rate(
            totals.failures, totals.completed, totals.errored, totals.unresolved
        ),
        log_probability_per_step=totals.log_probability / steps if steps else None,
        smallest_robustness_m=totals.smallest_robustness_m,
        median_robustness_m=totals.median_robustness_m,
    )


def choose_block_length(counts: Counts, wanted: int | None = None) -> int:
    """Return the number of indices of a block: 100, at most a tenth and at least a fiftieth of all.

    The length depends on the budget, not on the number of ended episodes. Blocks change only if a
    campaign ends early, since cancelled episodes do not count.

    Raises:
        InvalidValue: the wanted length makes too many blocks.
    """
    # A campaign that ended at once has no index left, and a block needs one.
    reach = max(counts.planned - counts.cancelled, 1)
    if wanted is None:
        return max(min(BLOCK_LENGTH, ceil(reach / FEWEST_BLOCKS)), ceil(reach / MOST_BLOCKS_SHOWN))
    least = ceil(counts.planned / summary.MOST_BLOCKS)
    if wanted < least:
        problem = f"{wanted} episodes a block could make more than {summary.MOST_BLOCKS} blocks."
        raise InvalidValue("per", problem, f"Take at least {least}.")
    return wanted


SECONDS_PER_HOUR = 3600.0


def price_failures(total_usd: float, instance_hours: float, failures: Rate | None) -> Cost:
    """Return the cost of a failure: the total ÷ number of failures, with the rate's interval.

    If a number of failures ended the campaign, the quotient is unbiased, as the mean number of
    episodes up to the k-th failure is k ÷ p. The bounds are total ÷ (ended × bound of the rate), so
    a campaign without failures has a lower bound instead of an infinite cost. A rate without an
    interval gives a cost without an interval.

    Args:
        total_usd: price of all instance-hours.
        instance_hours: time during which instances were occupied, summed over them. [h]
        failures: collisions among the completed episodes; None before the first one.
    """
    if failures is None:
        return Cost(total_usd, instance_hours, None, None, None)
    per_failure_usd = total_usd / failures.k if failures.k else None
    # A search chose the episodes: its share of failures has no interval, nor has the price.
    if failures.interval is None:
        return Cost(total_usd, instance_hours, per_failure_usd, None, None)
    at_least_usd = total_usd / (failures.trials * failures.interval.high)
    if per_failure_usd is None:
        return Cost(total_usd, instance_hours, None, None, at_least_usd)
    interval_usd = Interval(at_least_usd, total_usd / (failures.trials * failures.interval.low))
    return Cost(total_usd, instance_hours, per_failure_usd, interval_usd, at_least_usd)


BY_CLOCK = (
    "The curve takes an episode's time from when its result was stored; a mode is found with its "
    "failure of the lowest index."
)


PAUSED = "It was paused or moved: the longest gaps between results were cut to the time billed."


SLACK_S = 2.5
"""A bill is late by as much: a supervisor sends one every two seconds (its `RENEW_S`)."""


class KnownModes(NamedTuple):
    """The distinct modes of a campaign's newest analysis.

    Attributes:
        analysis: id of the analysis; None if no analysis is done.
        found_ms: time at which the first failure of each mode was stored; None if modes are
            unknown.
        words: number of modes with the reason, or why modes are unknown.
    """

    analysis: int | None
    found_ms: tuple[int, ...] | None
    words: str


def sum_instance_hours(campaign: Campaign, active_s: float) -> float:
    """Return the instance-hours of a campaign that was active for `active_s`. [h]"""
    return campaign.spec.instances * active_s / SECONDS_PER_HOUR


def bill_usd(campaign: Campaign, active_s: float) -> float:
    """Return price per instance-hour × instance-hours."""
    return campaign.spec.price_usd_per_hour * sum_instance_hours(campaign, active_s)


def split_time(campaign: Campaign, totals: summary.SpendingTotals) -> summary.TimeSplit:
    """Return how the billed time was spent; the parts sum to the billed time."""
    # The parts must sum to the bill: each is cut to what the others leave.
    worker_s, overhead = totals.completed_worker_s, campaign.overhead
    lost_worker_s = totals.errored_worker_s + overhead.discarded_s
    learns = traits_of(campaign.spec.method).learns
    # The supervisor bills a moment after the hub has accounted for its time; see `SLACK_S`.
    busy_s = max(campaign.active_s - overhead.learning_s - overhead.waiting_s, 0.0)
    # Workers are busy side by side, so that wall time is shared out as their time is.
    lost_share = lost_worker_s / (worker_s + lost_worker_s) if lost_worker_s > 0.0 else 0.0
    lost_s = busy_s * lost_share
    idle_s = campaign.active_s - busy_s
    learning_s = min(overhead.learning_s, idle_s)
    return summary.TimeSplit(
        active_s=campaign.active_s,
        worker_s=worker_s,
        simulation_s=busy_s - lost_s,
        startup_s=0.0 if learns else learning_s,
        learning_s=learning_s if learns else 0.0,
        waiting_s=idle_s - learning_s,
        lost_s=lost_s,
        lost_worker_s=lost_worker_s,
    )


def make_cost_curve(
    campaign: Campaign, totals: summary.SpendingTotals, modes: KnownModes
) -> Iterator[summary.CostPoint]:
    """Yield the points of the cost curve, from zero to the whole bill."""
    spent_s = _list_active_s(campaign, [each.at_ms for each in totals.progress])
    # The curve begins where nothing is spent, or its first step would not show.
    yield _make_point(campaign, 0.0, (0, 0), 0 if modes.found_ms is not None else None)
    for each, active_s in zip(totals.progress, spent_s, strict=True):
        known = _count_modes(modes, each.at_ms)
        yield _make_point(campaign, active_s, (each.completed, each.failures), known)
    if totals.progress:
        last = totals.progress[-1]
        known = _count_modes(modes, last.at_ms)
        yield _make_point(campaign, campaign.active_s, (last.completed, last.failures), known)


def _make_point(
    campaign: Campaign, active_s: float, found: tuple[int, int], modes: int | None
) -> summary.CostPoint:
    """Return the numbers of episodes and failures up to an active time."""
    completed, failures = found
    return summary.CostPoint(
        usd=bill_usd(campaign, active_s),
        active_s=active_s,
        completed=completed,
        failures=failures,
        modes=modes,
    )


def _count_modes(modes: KnownModes, at_ms: int) -> int | None:
    """Return the number of modes that were found by a time; None if modes are unknown."""
    return None if modes.found_ms is None else sum(each <= at_ms for each in modes.found_ms)


def _list_active_s(campaign: Campaign, at_ms: Sequence[int]) -> list[float]:
    """Return the active time at which each result was stored, in the order of the results. [s]

    The clock ran on while the campaign was paused. If the gaps between results sum to more than the
    billed time, the longest gaps are cut to one length, so that all gaps sum to the billed time.
    """
    start_ms = campaign.started_ms if campaign.started_ms is not None else campaign.created_ms
    gaps_s = np.maximum(np.diff([start_ms, *at_ms]) / 1_000.0, 0.0)
    longest_s = _find_longest_gap(gaps_s.tolist(), campaign.active_s)
    until_s = np.minimum(np.cumsum(np.minimum(gaps_s, longest_s)), campaign.active_s)
    return [float(each) for each in until_s]


def has_unbilled_time(campaign: Campaign, at_ms: Sequence[int]) -> bool:
    """Return whether more time passed until the last result than was billed."""
    if not at_ms or campaign.started_ms is None:
        return False
    return (at_ms[-1] - campaign.started_ms) / 1_000.0 > campaign.active_s + SLACK_S


def _find_longest_gap(gaps_s: Sequence[float], total_s: float) -> float:
    """Return c with Σ min(gap, c) = total; infinite if all gaps together fit in the total."""
    left_s, ordered = total_s, sorted(gaps_s)
    for place, gap_s in enumerate(ordered):
        share_s = left_s / (len(ordered) - place)
        if gap_s > share_s:
            return share_s
        left_s -= gap_s
    return float("inf")


NO_SEVERITY = "No failure has a severity."


NO_SEVERITY_OF_FUNCTION = "Severity is not measured for a function."


NO_TRAFFIC = "Near misses, MinTTC, DRAC and conflict classes are not measured for a function."


def make_safety(
    campaign: Campaign,
    totals: safety.SafetyTotals,
    conflicts: summary.Conflicts,
    unresolved: summary.Unresolved,
    level: float = safety.TAIL_LEVEL,
) -> safety.Safety:
    """Return the safety table of a campaign, from the sums over its completed episodes.

    If the simulator is a function, only failures are counted: a function does not have traffic.

    Args:
        campaign: campaign in its present state.
        totals: over its completed episodes.
        conflicts: these by class.
        unresolved: episodes without a collision only because they ended.
        level: level of VaR and CVaR of severity.

    Raises:
        InvalidValue: the level is not between 0 and 1.
    """
    method, errored = campaign.spec.method, campaign.counts.errored
    design, by_failures = (
        SamplingDesign.of([campaign.spec]),
        SamplingDesign.of_failures([campaign]),
    )
    doubtful = errored, unresolved.count
    # Numbers stand for any method; only independent episodes give them an interval.
    severity = tail_risk(totals.severities, level)
    correlation = rank_correlation(
        np.array([point.log_probability_per_step for point in totals.points]),
        np.array([point.severity for point in totals.points]),
    )
    if not traits_of(method).independent:
        severity, correlation = _drop_intervals(severity), _drop_interval(correlation)
    has_road = world_of(campaign.spec.simulator).has_road
    if totals.failures and not len(totals.severities):
        severity = replace(severity, problem=NO_SEVERITY if has_road else NO_SEVERITY_OF_FUNCTION)
    # A function has no traffic: 0 of 0 makes each share of it unknown instead of 0 %.
    measured = totals.completed if has_road else 0
    return safety.Safety(
        campaign=campaign.id,
        name=campaign.spec.name,
        method=method,
        completed=totals.completed,
        failures=_make_share(by_failures, totals.failures, totals.completed, *doubtful),
        collisions=_make_share(
            by_failures if campaign.spec.fails_by_collision_alone else design,
            conflicts.collisions + conflicts.allowed,
            totals.completed,
            *doubtful,
        ),
        near_misses=_make_share(design, conflicts.near_misses, measured, errored),
        conflicts=conflicts,
        ttc=_count_violations(design, totals.ttc, NEAR_MISS_TTC_S, measured, errored),
        drac=_count_violations(design, totals.drac, PEAK_BRAKING_MPS2, measured, errored),
        severity=severity,
        scatter=safety.Scatter(totals.points, len(totals.severities), correlation),
        unresolved=unresolved,
        requirements=tuple(_list_requirements(campaign, totals)),
        notes=tuple(_list_notes(campaign, totals, unresolved, conflicts)),
    )


def _list_requirements(
    campaign: Campaign, totals: safety.SafetyTotals
) -> Iterator[safety.RequirementFigures]:
    """Yield the figures of each requirement that the campaign names."""
    design, errored = SamplingDesign.of([campaign.spec]), campaign.counts.errored
    named = campaign.spec.named_requirements
    for place, each in enumerate(named):
        found = totals.requirements[place] if place < len(totals.requirements) else None
        yield safety.RequirementFigures(
            number=place + 1,
            name=each.label,
            words=each.in_words(),
            unit=each.unit,
            violations=_make_share(design, found.violations, found.n, errored) if found else None,
            worst=found.worst if found else None,
        )


def _drop_intervals(risk: safety.SeverityRisk) -> safety.SeverityRisk:
    """Return the severity without intervals, for failures that a search chose.

    Such failures are not a random sample. A problem that concerns only the interval is dropped; a
    problem of the number is kept.
    """
    mean, var, cvar = map(_drop_interval, (risk.mean, risk.var, risk.cvar))
    problem = "" if cvar else risk.problem
    return replace(risk, mean=mean, var=var, cvar=cvar, problem=problem)


def _drop_interval(figure: safety.Figure | None) -> safety.Figure | None:
    return safety.Figure(figure.value) if figure else None


def _make_share(
    design: SamplingDesign, k: int, n: int, errored: int, unresolved: int = 0
) -> Rate | None:
    if not n:
        return None
    # Totals and counts may have been read a few results apart.
    k = min(k, n)
    return design.make_rate(k, n, errored, min(unresolved, n - k))


def _count_violations(
    design: SamplingDesign,
    totals: safety.MeasureTotals,
    threshold: float,
    completed: int,
    errored: int,
) -> safety.Violations:
    """Return the figures of a measure compared with its threshold."""
    return safety.Violations(
        threshold=threshold,
        beyond=_make_share(design, totals.violations, completed, errored),
        n=totals.n,
        median=totals.median,
        worst=totals.worst,
    )


def _list_notes(
    campaign: Campaign,
    totals: safety.SafetyTotals,
    unresolved: summary.Unresolved,
    conflicts: summary.Conflicts,
) -> Iterator[str]:
    """Yield remarks on the limits of the numbers."""
    if words := unresolved.words(totals.completed):
        yield words
    if conflicts.allowed:
        yield (
            f"{conflicts.allowed:,} of the collisions are no failures, as no requirement forbids "
            "them. Classes, lead times and severities leave them out."
        )
    has_road = world_of(campaign.spec.simulator).has_road
    if totals.failures and not traits_of(campaign.spec.method).draws_from_prior:
        figures = "shares, medians and severities are" if has_road else "the share of failures is"
        lacks = ", and have no interval" if has_road else ", and has no interval"
        yield (
            f"The episodes are those that {campaign.spec.method} chose: {figures} of these, "
            "not of what p(x) would bring"
            f"{'' if traits_of(campaign.spec.method).independent else lacks}."
        )
    if not has_road:
        if totals.completed:
            yield NO_TRAFFIC
        return
    if missing := totals.failures - len(totals.severities):
        yield f"{missing} of {totals.failures} failures have no severity and are left out of it."
    if len(totals.points) < len(totals.severities):
        yield (
            f"The scatter shows {len(totals.points)} of {len(totals.severities)} failures, evenly "
            "spread in index order."
        )
