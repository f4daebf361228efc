"""The row of a campaign in a result table."""

from collections.abc import Sequence

from eigenfail.contracts import Store
from eigenfail.values import Campaign, Conflicts, Cost, MeanTime, Rate, Summary, Unresolved
from eigenfail.values.records import ConflictTotals, Totals
from eigenfail_services.analysis.cost import cost
from eigenfail_services.campaigns.horizon import horizon_s
from eigenfail_services.statistics.intervals import rate


def summarise(campaign: Campaign, totals: Totals) -> Summary:
    """What a campaign found, how quickly, and at what price, so far.

    Rate and cost rest on the campaign's counts, means on the totals: while a campaign runs the two
    may have been read a few results apart.
    """
    completed = campaign.counts.completed
    return Summary(
        campaign=campaign.id,
        name=campaign.spec.name,
        method=campaign.spec.method,
        counts=campaign.counts,
        failure_rate=failure_rate(campaign),
        mean_log_probability=ratio(totals.log_probability, totals.failures),
        log_probability_per_step=ratio(totals.log_probability, totals.steps),
        mean_severity=ratio(totals.severity, totals.failures),
        episodes_per_s=ratio(completed, campaign.active_s),
        cost=campaign_cost(campaign),
        conflicts=conflicts(totals.conflicts),
        estimate=campaign.estimate,
        unresolved=unresolved(campaign, totals.conflicts),
    )


def summaries_of(store: Store, campaigns: Sequence[Campaign]) -> list[Summary]:
    """The summaries of some campaigns, in their order, at the price of one."""
    totals = store.figures.totals([campaign.id for campaign in campaigns])
    return [summarise(campaign, totals[campaign.id]) for campaign in campaigns]


def conflicts(totals: ConflictTotals) -> Conflicts:
    """Episodes by class, and the means of their lead times."""
    return Conflicts(
        unavoidable=totals.unavoidable,
        planner_failures=totals.planner_failures,
        unclassified=totals.unclassified,
        near_misses=totals.near_misses,
        ttc_lead=MeanTime(ratio(totals.ttc_lead_s, totals.ttc_leads), totals.ttc_leads),
        drac_lead=MeanTime(ratio(totals.drac_lead_s, totals.drac_leads), totals.drac_leads),
    )


def unresolved(campaign: Campaign, totals: ConflictTotals) -> Unresolved:
    """Episodes that are no failures only because they ended, and when they did."""
    return Unresolved(totals.unresolved, totals.perhaps_unresolved, horizon_s(campaign.spec))


def failure_rate(campaign: Campaign) -> Rate | None:
    """Collisions within the horizon ÷ completed episodes; None before the first one."""
    counts = campaign.counts
    return rate(counts.failures, counts.completed) if counts.completed else None


def campaign_cost(campaign: Campaign) -> Cost:
    """What its instances cost while it was running."""
    return cost(
        active_s=campaign.active_s,
        instances=campaign.spec.instances,
        price_usd_per_hour=campaign.spec.price_usd_per_hour,
        failures=campaign.counts.failures,
        completed=campaign.counts.completed,
    )


def ratio(amount: float | None, per: float) -> float | None:
    """The quotient, or None of nothing."""
    return None if amount is None or not per else amount / per
