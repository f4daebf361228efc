"""What a comparison says, in plain sentences, each with what it rests on."""

from collections.abc import Iterator, Sequence
from math import floor, log10

from eigenfail.values import (
    FINAL_STATES,
    Campaign,
    Comparison,
    Cost,
    Difference,
    EffectSize,
    Interval,
    McNemar,
    Side,
)
from eigenfail_services.campaigns.pairing import PAIRABLE

SMALLEST_P = 1e-4
LEVEL = 0.05


def sentences(found: Comparison) -> tuple[str, ...]:
    """What was found, most important first."""
    a, b, pairs = found.a, found.b, found.pairs
    return (
        f"A {fails(a)}; B {fails(b)}.",
        *([more_or_fewer(found.difference)] if found.difference else []),
        paired(pairs) if pairs else f"Episodes are not paired: {found.unpaired_because}",
        f"A failure costs {price(a.cost)} with A, {price(b.cost)} with B.",
        *likelihood(a, b),
        *([over_seeds(found.effect)] if found.effect else []),
    )


def fails(side: Side) -> str:
    """How often a side fails."""
    rate = side.failure_rate
    if rate is None:
        return "has completed no episode"
    return f"fails in {percent(rate.value)} {bounds(rate.interval)} of {rate.n} episodes"


def more_or_fewer(found: Difference) -> str:
    """Which side fails more often, where that can be told."""
    if found.interval.low <= 0.0 <= found.interval.high:
        return (
            "From the rates alone no difference can be told: B − A is "
            f"{percent(found.value, '+')} {bounds(found.interval)} of the episodes."
        )
    word = "more" if found.value > 0.0 else "fewer"
    near, far = sorted((abs(found.interval.low), abs(found.interval.high)))
    size = f"{percent(abs(found.value))} {bounds(Interval(near, far))}"
    return f"B fails in {size} {word} of the episodes than A."


def paired(found: McNemar) -> str:
    """How the sides did under the same noise."""
    verdict = "tells them apart" if found.p_value < LEVEL else "does not tell them apart"
    return (
        f"Both saw the same noise in {found.n} pairs of episodes: {found.only_b} where only B "
        f"failed, {found.only_a} where only A did, {found.both} where both did; McNemar's exact "
        f"test {verdict} ({chance(found.p_value)})."
    )


def over_seeds(found: EffectSize) -> str:
    """How much higher the failure rates of one side's campaigns are."""
    return (
        f"A campaign of B fails more often than one of A with probability {found.a12:.2f}: "
        f"{found.magnitude} effect (Vargha–Delaney A12, n = {found.n_a} and {found.n_b} campaigns)."
    )


def likelihood(a: Side, b: Side) -> Iterator[str]:
    """Whose failures are likelier, where both have some."""
    of_a, of_b = a.log_probability_per_step, b.log_probability_per_step
    if of_a is not None and of_b is not None:
        yield (
            f"log p per step of the failures is {of_a:.2f} with A (n = {a.failures}), "
            f"{of_b:.2f} with B (n = {b.failures}); higher is likelier."
        )


def confounded(differing: Sequence[str]) -> Iterator[str]:
    """That a difference has more than one possible cause, or none.

    Args:
        differing: the things in which the sides differ.
    """
    if len(differing) > 1:
        yield (
            f"A and B differ in more than one thing ({', '.join(differing)}): what is found cannot "
            "be laid to one of them alone."
        )
    if not differing:
        yield "A and B were asked for the same thing: only their seeds can differ."


def impure(side: str, differing: Sequence[str]) -> Iterator[str]:
    """That the campaigns of a side are not of one kind.

    Args:
        side: its name.
        differing: the things in which its campaigns differ among themselves.
    """
    if differing:
        yield f"The campaigns of {side} differ among themselves in {', '.join(differing)}."


def by_luck(campaigns: Sequence[Campaign]) -> Iterator[str]:
    """That intervals know nothing of the luck of a learner's seed."""
    learning = sorted({campaign.spec.method for campaign in campaigns} - PAIRABLE)
    if learning:
        yield (
            f"Episodes of {' and '.join(learning)} depend on what was learnt: intervals know "
            "the luck of the episodes, not that of the training seed. Compare several seeds."
        )


def unfinished(campaigns: Sequence[Campaign]) -> Iterator[str]:
    """That figures may still change."""
    for campaign in campaigns:
        if campaign.state not in FINAL_STATES:
            yield f"Campaign {campaign.id} is {campaign.state}: its figures may still change."


def percent(share: float, sign: str = "") -> str:
    """A share in percent."""
    return f"{100.0 * share:{sign}.1f} %"


def bounds(interval: Interval) -> str:
    """An interval of a share, in percent."""
    return f"[{100.0 * interval.low:.1f}, {100.0 * interval.high:.1f}]"


def price(cost: Cost) -> str:
    """What a failure costs, with its interval, or at least."""
    if cost.per_failure_usd is not None and cost.interval_usd is not None:
        low, high = cost.interval_usd.low, cost.interval_usd.high
        return f"{usd(cost.per_failure_usd)} USD [{usd(low)}, {usd(high)}]"
    if cost.at_least_usd is not None:
        return f"at least {usd(cost.at_least_usd)} USD"
    return "nobody knows what"


def usd(amount: float) -> str:
    """With at least two decimals and at least two significant digits."""
    digits = 2 if amount <= 0.0 else max(2, 1 - floor(log10(amount)))
    return f"{amount:.{digits}f}"


def chance(p_value: float) -> str:
    """A p-value, as small as it is worth telling."""
    return f"p < {SMALLEST_P:.4f}" if p_value < SMALLEST_P else f"p = {p_value:.4f}"
