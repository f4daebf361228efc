"""Two groups of campaigns compared, in numbers and sentences; many campaigns side by side."""

from collections.abc import Iterator, Sequence
from math import comb

from msgspec.structs import replace

from eigenfail.errors import InvalidValue
from eigenfail.intervals import difference, mcnemar, paired_difference
from eigenfail.presentation import figures
from eigenfail.presentation.rates import explain_design, format_counted_rate, format_rate
from eigenfail.values.campaign import FINAL_STATES, Campaign
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.comparison import Comparison, Difference, EffectSize, McNemar, Side
from eigenfail.values.estimates import Cost, Interval, Rate
from eigenfail.versions import describe_mixed
from eigenfail_services.analysis import campaign_figures
from eigenfail_services.analysis.sampling_design import SamplingDesign
from eigenfail_services.campaigns.summary import divide, find_failure_rate
from eigenfail_services.comparison import comparability
from eigenfail_services.statistics import comparison
from eigenfail_services.store.store import Store

SMALLEST_P = 1e-4


def _list_sentences(found: Comparison) -> tuple[str, ...]:
    a, b, pairs = found.a, found.b, found.pairs
    return (
        f"A {_describe_failures(a)}; B {_describe_failures(b)}.",
        *(
            [_compare_rates(found.difference, pairs)]
            if found.difference and found.is_sampled
            else []
        ),
        _describe_pair_test(pairs)
        if pairs
        else f"Episodes are not paired: {found.unpaired_because}",
        f"A failure costs {_format_price(a.cost)} with A, {_format_price(b.cost)} with B.",
        *_compare_likelihood(a, b),
        *([_compare_seeds(found.effect)] if found.effect else _explain_no_effect(a, b)),
    )


def _describe_failures(side: Side) -> str:
    rate = side.failure_rate
    if rate is None:
        return "has completed no episode"
    if rate.interval is None:
        return f"fails in {rate.k} of the {rate.n} episodes that it chose"
    if not rate.k:
        return f"fails in {format_counted_rate(rate)}"
    return f"fails in {format_rate(rate)} of {rate.n} episodes"


def _compare_rates(found: Difference, pairs: McNemar | None) -> str:
    size = f"{figures.format_signed(100.0 * found.value)} %"
    interval = figures.format_signed_interval(found.interval, 100.0)
    if found.interval.low <= 0.0 <= found.interval.high:
        basis = "The pairs" if found.is_paired else "The rates alone"
        return f"{basis} show no difference: B − A is {size} {interval} of the episodes."
    if not is_beyond_chance(found, pairs):
        return (
            f"Whether they differ is open: B − A is {size} {interval} of the episodes, and the "
            "exact test on the pairs does not distinguish them."
        )
    word = "more" if found.value > 0.0 else "less"
    near, far = sorted((abs(found.interval.low), abs(found.interval.high)))
    points = figures.format_number(100.0 * abs(found.value))
    interval = figures.format_interval(Interval(near, far), 100.0)
    return f"B fails {points} percentage points {interval} {word} often than A."


def is_beyond_chance(found: Difference, pairs: McNemar | None) -> bool:
    """Return whether two rates differ by more than chance.

    The interval excludes 0. For pairs, McNemar's exact test must distinguish the sides as well:
    their score interval is approximate, and too narrow if few pairs differ.
    """
    # Tango's score interval is approximate, and too narrow where few pairs differ.
    excludes_none = not found.interval.low <= 0.0 <= found.interval.high
    is_exact = not found.is_paired or (
        pairs is not None and pairs.p_value < comparison.SIGNIFICANCE
    )
    return excludes_none and is_exact


def _describe_pair_test(found: McNemar) -> str:
    verdict = (
        "distinguishes them"
        if found.p_value < comparison.SIGNIFICANCE
        else "does not distinguish them"
    )
    return (
        f"Both saw the same noise in {found.n} pairs of episodes: {found.only_b} where only B "
        f"failed, {found.only_a} where only A did, {found.both} where both did; McNemar's exact "
        f"test {verdict} ({format_p_value(found.p_value)})."
    )


def _compare_seeds(found: EffectSize) -> str:
    return (
        f"A campaign of B fails more often than one of A with probability {found.a12:.2f}: "
        f"{found.magnitude} effect (Vargha–Delaney A12, n = {found.n_a} and {found.n_b} campaigns)."
    )


def _compare_likelihood(a: Side, b: Side) -> Iterator[str]:
    of_a, of_b = a.log_probability_per_step, b.log_probability_per_step
    if of_a is not None and of_b is not None:
        yield (
            f"log p per step of the failures is {of_a:.2f} with A (n = {a.failures}), "
            f"{of_b:.2f} with B (n = {b.failures}); higher is likelier."
        )


def _list_confounders(differing: Sequence[str]) -> Iterator[str]:
    """Warn that a difference has more than one possible cause, or none.

    Args:
        differing: the things that differ between the sides.
    """
    if len(differing) > 1:
        yield (
            f"A and B differ in more than one thing ({', '.join(differing)}): a difference cannot "
            "be attributed to one of them alone."
        )
    if not differing:
        yield "A and B were asked for the same thing: only their seeds can differ."


def _warn_of_mixture(side: str, differing: Sequence[str]) -> Iterator[str]:
    """Warn that the campaigns of a side are not of one kind.

    Args:
        side: its name.
        differing: the things that differ among its campaigns.
    """
    if differing:
        yield f"The campaigns of {side} differ among themselves in {', '.join(differing)}."


def warn_of_seeds(campaigns: Sequence[Campaign]) -> Iterator[str]:
    """Warn that intervals do not cover the spread between seeds of a learner."""
    learning = comparability.list_unpairable(campaigns)
    if learning:
        yield (
            f"Episodes of {' and '.join(learning)} depend on what was learnt: intervals know "
            "variation between episodes, not between training seeds. Compare several seeds."
        )


def _warn_of_errors(side: str, campaigns: Sequence[Campaign]) -> Iterator[str]:
    count = sum(campaign.counts.errored for campaign in campaigns)
    completed = sum(campaign.counts.completed for campaign in campaigns)
    if count and not completed:
        yield f"Every episode of {side} errored ({count:,}): there is nothing to compare."
    elif count:
        total = count + completed
        yield (
            f"{count:,} of {total:,} episodes of {side} errored: its rate leaves them out, and an "
            "upper bound counts them as failures."
        )


def warn_of_unfinished(campaigns: Sequence[Campaign]) -> Iterator[str]:
    """Warn that figures of running campaigns may still change."""
    for campaign in campaigns:
        if campaign.state not in FINAL_STATES:
            yield f"Campaign {campaign.id} is {campaign.state}: its figures may still change."


def _format_price(cost: Cost) -> str:
    if cost.per_failure_usd is not None and cost.interval_usd is not None:
        interval = figures.format_usd_interval(cost.interval_usd)
        return f"{figures.format_money(cost.per_failure_usd)} {interval}"
    if cost.at_least_usd is not None:
        return f"at least {figures.format_money(figures.round_down(cost.at_least_usd))}"
    if cost.per_failure_usd is not None:
        return figures.format_money(cost.per_failure_usd)
    return "an unknown amount"


def format_p_value(p_value: float) -> str:
    """Format a p-value; below `SMALLEST_P` as a bound."""
    return f"p < {SMALLEST_P:.4f}" if p_value < SMALLEST_P else f"p = {p_value:.4f}"


def compare(store: Store, a: Sequence[int], b: Sequence[int]) -> Comparison:
    """Compare failure rates, cost, likelihood and pairs of two groups of campaigns.

    Args:
        store: store with the campaigns.
        a: ids of campaigns that differ in their seeds alone.
        b: ids of such campaigns for side B.

    Raises:
        InvalidValue: a side without a campaign, or a campaign that is named twice.
        NotFound: no such campaign.
    """
    _refuse_repeats(a, b)
    ones, others = ([store.campaigns.get(campaign) for campaign in ids] for ids in (a, b))
    left, right, pairing = (
        _summarise_side(store, ones),
        _summarise_side(store, others),
        comparability.pair_episodes(store, ones, others),
    )
    found = Comparison(
        a=left,
        b=right,
        # Pairs saw the same noise, so their difference leaves less to chance than that of two
        # separate rates.
        difference=_find_paired_difference(pairing, [*ones, *others])
        or _find_difference(left, right, ones, others),
        pairs=mcnemar(pairing.totals) if pairing.totals else None,
        unpaired_because=pairing.because,
        effect=_find_effect(left, right),
        distinctions=comparability.find_distinctions(_list_specs(ones), _list_specs(others)),
    )
    rates = [side.failure_rate for side in (left, right) if side.failure_rate]
    caveats = (
        *_list_confounders(comparability.find_differing_fields(found.distinctions)),
        *_warn_of_mixture("A", comparability.find_mixed_fields(_list_specs(ones))),
        *_warn_of_mixture("B", comparability.find_mixed_fields(_list_specs(others))),
        # Both sides mostly have one design: it is explained once.
        *dict.fromkeys(filter(None, map(explain_design, rates))),
        *warn_of_seeds([*ones, *others]),
        *_warn_of_errors("A", ones),
        *_warn_of_errors("B", others),
        # The last sentence is advice, which would be repeated for each campaign.
        *(note for one in (*ones, *others) for note in describe_mixed(one)[:-1]),
        *warn_of_unfinished([*ones, *others]),
    )
    return replace(found, sentences=_list_sentences(found), warnings=caveats)


def _list_specs(campaigns: Sequence[Campaign]) -> list[CampaignSpec]:
    return [campaign.spec for campaign in campaigns]


def _refuse_repeats(a: Sequence[int], b: Sequence[int]) -> None:
    """Make sure that every campaign is named once.

    Raises:
        InvalidValue: one is named twice, or a side has none.
    """
    for name, side in (("a", a), ("b", b)):
        if not side:
            raise InvalidValue(name, "names no campaign.", "Name at least one on each side.")
    # A campaign that is named twice would count twice, or be compared with itself.
    named = [*a, *b]
    for campaign in named:
        if named.count(campaign) > 1:
            raise InvalidValue(
                "campaigns",
                f"Campaign {campaign} is listed twice.",
                "Name each campaign once, on one side.",
            )


def _summarise_side(store: Store, campaigns: Sequence[Campaign]) -> Side:
    totals = store.figures.totals([campaign.id for campaign in campaigns]).values()
    completed = sum(campaign.counts.completed for campaign in campaigns)
    failures = sum(campaign.counts.failures for campaign in campaigns)
    errored = sum(campaign.counts.errored for campaign in campaigns)
    unresolved = [each.conflicts.unresolved for each in totals]
    rates = [find_failure_rate(*each) for each in zip(campaigns, unresolved, strict=True)]
    design = SamplingDesign.of_failures(campaigns)
    pooled = design.make_rate(failures, completed, errored, sum(unresolved)) if completed else None
    severities = [each.severity for each in totals if each.severity is not None]
    collisions = sum(each.conflicts.collisions for each in totals)
    return Side(
        campaigns=tuple(campaign.id for campaign in campaigns),
        completed=completed,
        failures=failures,
        failure_rate=pooled,
        rates=tuple(each.share if each else None for each in rates),
        log_probability_per_step=divide(
            sum(each.log_probability for each in totals), sum(each.steps for each in totals)
        ),
        mean_severity=divide(sum(severities) if severities else None, collisions),
        cost=_sum_cost(campaigns, pooled),
    )


def _sum_cost(campaigns: Sequence[Campaign], failures: Rate | None) -> Cost:
    total_usd = sum(
        campaign_figures.bill_usd(campaign, campaign.active_s) for campaign in campaigns
    )
    hours = sum(
        campaign_figures.sum_instance_hours(campaign, campaign.active_s) for campaign in campaigns
    )
    return campaign_figures.price_failures(total_usd, hours, failures)


def _find_paired_difference(
    pairing: comparability.PairedEpisodes, campaigns: Sequence[Campaign]
) -> Difference | None:
    """Return the difference over the pairs; None without pairs.

    Also None if a stop rule judged failures: the number of pairs is then not fixed. Also None if
    episodes errored: a pair with an errored episode would be left out, whatever that episode hides.
    """
    if pairing.totals is None or SamplingDesign.of_failures(campaigns).judges_failures:
        return None
    if any(campaign.counts.errored for campaign in campaigns):
        return None
    return paired_difference(pairing.totals)


def _find_difference(
    a: Side, b: Side, ones: Sequence[Campaign], others: Sequence[Campaign]
) -> Difference | None:
    if a.failure_rate is None or b.failure_rate is None:
        return None
    return difference(
        _bound_both_sides(a.failure_rate, ones), _bound_both_sides(b.failure_rate, others)
    )


def _bound_both_sides(rate: Rate, campaigns: Sequence[Campaign]) -> Rate:
    """Return a rate with a two-sided interval; a search counts as if its episodes were a sample."""
    bounds = SamplingDesign.of_failures(campaigns).find_bounds(rate)
    return replace(rate, interval=bounds, sampled=True)


def _find_effect(a: Side, b: Side) -> EffectSize | None:
    """Return A12 over the campaigns; None if they are too few to show anything."""
    ones, others = (_list_known_rates(side) for side in (a, b))
    return (
        comparison.effect_size(ones, others)
        if comparison.can_distinguish(len(ones), len(others))
        else None
    )


def _list_known_rates(side: Side) -> list[float]:
    return [value for value in side.rates if value is not None]


def _explain_no_effect(a: Side, b: Side) -> Iterator[str]:
    """Yield the reason for a missing effect size over several seeds of each side."""
    n_a, n_b = (len(_list_known_rates(side)) for side in (a, b))
    if min(n_a, n_b) > 1 and not comparison.can_distinguish(n_a, n_b):
        yield (
            f"{n_a} and {n_b} campaigns show no effect over seeds: full separation would be chance "
            f"with p = {2.0 / comb(n_a + n_b, n_a):.2g}. Run four seeds of each, or more."
        )


FEWEST, MOST = 2, 12


def read_distinct_campaigns(ids: Sequence[int], store: Store) -> tuple[Campaign, ...]:
    """Return the campaigns to compare, each once, in the given order.

    Raises:
        InvalidValue: they are too many.
        NotFound: no such campaign.
    """
    different = tuple(dict.fromkeys(ids))
    if len(different) > MOST:
        problem = f"{len(different)} campaigns are named; {FEWEST} to {MOST} can be compared."
        raise InvalidValue("campaign", problem, "Specify fewer campaigns.")
    return tuple(map(store.campaigns.get, different))


def group_by_seed(campaigns: Sequence[Campaign]) -> tuple[comparability.Group, ...]:
    """Group campaigns that differ only in name and seed; if that is one group, each is alone."""
    found = comparability.group_alike(campaigns)
    return found if len(found) > 1 else tuple((campaign,) for campaign in campaigns)


def against_first(store: Store, found: Sequence[comparability.Group]) -> tuple[Comparison, ...]:
    """Compare every group but the first, as B, with the first, as A."""
    first, *others = ([campaign.id for campaign in group] for group in found)
    return tuple(compare(store, first, other) for other in others)
