"""Two groups of campaigns side by side, from what the store holds of them."""

from collections.abc import Sequence

from msgspec.structs import replace

from eigenfail.contracts import Store
from eigenfail.errors import InvalidValue
from eigenfail.values import Campaign, CampaignSpec, Comparison, Cost, Difference, EffectSize, Side
from eigenfail_services.analysis.cost import cost
from eigenfail_services.campaigns.comparison_words import (
    by_luck,
    confounded,
    impure,
    sentences,
    unfinished,
)
from eigenfail_services.campaigns.distinctions import distinctions, mixed, things
from eigenfail_services.campaigns.pairing import pair
from eigenfail_services.campaigns.summary import failure_rate, ratio
from eigenfail_services.statistics.comparison import difference, mcnemar
from eigenfail_services.statistics.effect_size import LEAST, effect_size
from eigenfail_services.statistics.intervals import rate


def compare(store: Store, a: Sequence[int], b: Sequence[int]) -> Comparison:
    """Failure rates, cost, likelihood and pairs of two groups of campaigns.

    Args:
        store: where the campaigns are.
        a: ids of campaigns that differ in their seeds alone.
        b: the same for the other side.

    Raises:
        InvalidValue: a side without a campaign, or a campaign that is named twice.
        NotFound: no such campaign.
    """
    refuse_repeats(a, b)
    ones, others = ([store.campaigns.get(campaign) for campaign in ids] for ids in (a, b))
    left, right, pairing = side_of(store, ones), side_of(store, others), pair(store, ones, others)
    found = Comparison(
        a=left,
        b=right,
        difference=difference_of(left, right),
        pairs=mcnemar(pairing.totals) if pairing.totals else None,
        unpaired_because=pairing.because,
        effect=effect_of(left, right),
        distinctions=distinctions(specs(ones), specs(others)),
    )
    caveats = (
        *confounded(things(found.distinctions)),
        *impure("A", mixed(specs(ones))),
        *impure("B", mixed(specs(others))),
        *by_luck([*ones, *others]),
        *unfinished([*ones, *others]),
    )
    return replace(found, sentences=sentences(found), warnings=caveats)


def specs(campaigns: Sequence[Campaign]) -> list[CampaignSpec]:
    """What was asked for."""
    return [campaign.spec for campaign in campaigns]


def refuse_repeats(a: Sequence[int], b: Sequence[int]) -> None:
    """Every campaign counts once.

    Raises:
        InvalidValue: one is named twice, or a side has none.
    """
    for name, side in (("a", a), ("b", b)):
        if not side:
            raise InvalidValue(name, "names no campaign.", "Name at least one on each side.")
    named = [*a, *b]
    for campaign in named:
        if named.count(campaign) > 1:
            raise InvalidValue(
                "campaigns",
                f"{campaign} is named twice.",
                "Name each campaign once, on one side.",
            )


def side_of(store: Store, campaigns: Sequence[Campaign]) -> Side:
    """What these campaigns found together."""
    totals = [store.episodes.totals(campaign.id) for campaign in campaigns]
    completed = sum(campaign.counts.completed for campaign in campaigns)
    failures = sum(campaign.counts.failures for campaign in campaigns)
    rates = [failure_rate(campaign) for campaign in campaigns]
    severities = [each.severity for each in totals if each.severity is not None]
    return Side(
        campaigns=tuple(campaign.id for campaign in campaigns),
        completed=completed,
        failures=failures,
        failure_rate=rate(failures, completed) if completed else None,
        rates=tuple(each.value if each else None for each in rates),
        log_probability_per_step=ratio(
            sum(each.log_probability for each in totals), sum(each.steps for each in totals)
        ),
        mean_severity=ratio(sum(severities) if severities else None, failures),
        cost=cost_of(campaigns, failures, completed),
    )


def cost_of(campaigns: Sequence[Campaign], failures: int, completed: int) -> Cost:
    """What they cost together, at the mean price of an hour."""
    instance_s = [campaign.active_s * campaign.spec.instances for campaign in campaigns]
    prices = [campaign.spec.price_usd_per_hour for campaign in campaigns]
    paid = sum(seconds * price for seconds, price in zip(instance_s, prices, strict=True))
    active_s = sum(instance_s)
    price = paid / active_s if active_s else 0.0
    return cost(active_s, 1, price, failures, completed)


def difference_of(a: Side, b: Side) -> Difference | None:
    """The failure rate of B minus that of A; None before both have completed an episode."""
    if not (a.completed and b.completed):
        return None
    return difference(a.failures, a.completed, b.failures, b.completed)


def effect_of(a: Side, b: Side) -> EffectSize | None:
    """A12 over the campaigns; None of fewer than two on a side with an episode."""
    known = [[value for value in side.rates if value is not None] for side in (a, b)]
    return effect_size(*known) if min(map(len, known)) >= LEAST else None
