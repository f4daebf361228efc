"""The figures of a campaign, each with its uncertainty."""

import msgspec

from eigenfail.values import FINAL_STATES, Campaign, Estimate, Summary
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.states import CAMPAIGN_BADGES, Badge

NOTHING_YET = ("no episode completed",)


class Figure(msgspec.Struct, frozen=True):
    """A figure, and what it rests on."""

    value: str
    notes: tuple[str, ...] = ()


class Standing(msgspec.Struct, frozen=True, kw_only=True):
    """A campaign as it stands, in text.

    Attributes:
        is_open: whether it may still change by itself or by what a user asks.
        ended: episodes with a result; of `planned`, of which `wanted` are not left unrun.
        remaining: how long it will take still, if that can be said, or what was left unrun.
    """

    id: int
    name: str
    method: str
    planner: str
    scenario: str
    simulator: str
    badge: Badge
    is_open: bool
    because: str
    ended: int
    planned: int
    wanted: int
    remaining: str
    failures: Figure
    probability: Figure | None
    cost: Figure
    total: Figure
    likelihood: Figure
    severity: Figure
    speed: Figure


def standing(campaign: Campaign, summary: Summary) -> Standing:
    """A campaign and its summary as text."""
    spec, counts = campaign.spec, campaign.counts
    return Standing(
        id=campaign.id,
        name=spec.name,
        method=spec.method,
        planner=spec.planner,
        scenario=spec.scenario,
        simulator=spec.simulator,
        badge=CAMPAIGN_BADGES[campaign.state],
        is_open=campaign.state not in FINAL_STATES,
        because=campaign.stopped_because,
        ended=counts.completed + counts.failed,
        planned=counts.planned,
        wanted=counts.planned - counts.cancelled,
        remaining=remaining(campaign, summary),
        failures=failures(summary),
        probability=probability(summary.estimate),
        cost=cost(summary),
        total=total(campaign, summary),
        likelihood=Figure(formats.number(summary.log_probability_per_step), ("of the failures",)),
        severity=Figure(formats.number(summary.mean_severity), ("of the failures",)),
        speed=Figure(
            formats.number(summary.episodes_per_s), (f"in {formats.duration(campaign.active_s)}",)
        ),
    )


def remaining(campaign: Campaign, summary: Summary) -> str:
    """How long the open episodes take at the pace so far, or how many were left unrun."""
    if campaign.counts.cancelled:
        return f"{formats.integer(campaign.counts.cancelled)} not run"
    if campaign.state != "running" or not summary.episodes_per_s:
        return ""
    return f"about {formats.duration(campaign.counts.open / summary.episodes_per_s)} left"


def failures(summary: Summary) -> Figure:
    """How many, and at what rate."""
    rate = summary.failure_rate
    if rate is None:
        return Figure(formats.NONE, NOTHING_YET)
    if not rate.k:
        notes = (f"≤ {formats.percent(rate.interval.high)}", "95 % upper bound, near 3/n")
    else:
        notes = (formats.percent(rate.value), formats.rate_interval(rate))
    remark = (summary.remark,) if summary.remark else ()
    return Figure(f"{formats.integer(rate.k)} of {formats.integer(rate.n)}", (*notes, *remark))


def probability(estimate: Estimate | None) -> Figure | None:
    """Of a failure under p(x), or why it is not told; None where the method tells none."""
    if estimate is None:
        return None
    if estimate.interval is None:
        return Figure(formats.NONE, (estimate.by, estimate.problem))
    basis = (f"n = {formats.integer(estimate.episodes)}", f"cv {formats.number(estimate.cv)}")
    notes = (formats.interval(estimate.interval), *basis, estimate.by, estimate.note)
    return Figure(formats.number(estimate.probability), notes)


def cost(summary: Summary) -> Figure:
    """What a failure cost, from how many failures, and how sure that is."""
    return Figure(formats.cost_per_failure(summary.cost), cost_notes(summary))


def cost_notes(summary: Summary) -> tuple[str, ...]:
    """What the cost per failure rests on."""
    price, counts = summary.cost, summary.counts
    if price.interval_usd is not None:
        return (f"n = {formats.integer(counts.failures)}", formats.interval(price.interval_usd))
    if price.at_least_usd is not None:
        return (f"n = 0 in {formats.integer(counts.completed)}", "95 % lower bound")
    return NOTHING_YET


def speed(campaign: Campaign, summary: Summary) -> Figure:
    """Episodes per second of the time that it was running."""
    lasted = formats.duration(campaign.active_s)
    return Figure(formats.number(summary.episodes_per_s), (f"in {lasted}",))


def total(campaign: Campaign, summary: Summary) -> Figure:
    """What all of it cost."""
    hours = formats.number(summary.cost.instance_hours)
    price = formats.number(campaign.spec.price_usd_per_hour)
    return Figure(f"{formats.number(summary.cost.total_usd)} USD", (f"{hours} h × {price} USD/h",))
