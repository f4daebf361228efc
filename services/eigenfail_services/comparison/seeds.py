"""Figures over seeds, of campaigns that differ in their seeds alone; tables of suites."""

from collections.abc import Iterator, Sequence
from math import inf
from typing import NamedTuple

from msgspec.structs import replace

from eigenfail import suites
from eigenfail.errors import NotFound
from eigenfail.intervals import ERROR, find_upper_bound
from eigenfail.presentation.rates import explain_design, format_counted_rate
from eigenfail.suites import KeyPath, format_value, shorten_paths
from eigenfail.values.campaign import FINAL_STATES, Campaign, CampaignFilter
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.estimates import Cost, Rate
from eigenfail.values.seeds import FirstFailures, SeedFigure, SeedSpread, SeedValue
from eigenfail.values.suite import SuiteRow, SuiteTable, member_of
from eigenfail.values.summary import Summary
from eigenfail.values.variation import in_words
from eigenfail_services.analysis.campaign_figures import price_failures
from eigenfail_services.analysis.sampling_design import SamplingDesign
from eigenfail_services.campaigns.summary import summarise_campaigns
from eigenfail_services.comparison.comparability import (
    THINGS,
    Group,
    group_alike,
    list_differing,
    list_given_settings,
)
from eigenfail_services.statistics.seed_spread import PairSums, find_ratio, measure_spread
from eigenfail_services.store.store import Store

DEFAULTS = "defaults"
"""Name of a group that has none of the settings in which others differ."""

OF_THE_SEARCH = (
    "The interval is that of the mean over seeds of this search with this budget, not of a failure "
    "rate under p(x)."
)


class _Member(NamedTuple):
    """A campaign of a group with a completed episode, and its summary."""

    campaign: Campaign
    summary: Summary

    @property
    def seed(self) -> int:
        return self.campaign.spec.seed

    @property
    def share(self) -> float:
        return self.summary.counts.failures / self.summary.counts.completed

    @property
    def first(self) -> float:
        """Return the number of episodes up to the first failure; infinite without one."""
        found = self.summary.first_failure
        return inf if found is None else found + 1.0


def find_spreads(store: Store, campaigns: Sequence[int]) -> tuple[SeedSpread, ...]:
    """Return the figures over seeds of each group of campaigns that differ in their seeds alone.

    Args:
        store: store of the campaigns.
        campaigns: their ids; each counts once.

    Raises:
        NotFound: no such campaign.
    """
    found = [store.campaigns.get(campaign) for campaign in dict.fromkeys(campaigns)]
    return make_spreads(found, summarise_campaigns(store, found))


def make_spreads(
    campaigns: Sequence[Campaign], summaries: Sequence[Summary]
) -> tuple[SeedSpread, ...]:
    """Return the figures over seeds of each group with several seeds.

    Groups without a completed episode are left out.

    Args:
        campaigns: campaigns of any kind, each once.
        summaries: their summaries, in the same order.
    """
    if len({campaign.spec.seed for campaign in campaigns}) < 2:
        return ()
    summary_of = {summary.campaign: summary for summary in summaries}
    groups = group_alike(campaigns)
    paths = list_differing([campaign.spec for campaign in campaigns]) if len(groups) > 1 else []
    # Labels do not part groups, so that they name none.
    names = shorten_paths(path for path in paths if path[0] in THINGS)
    found = (
        _make_spread(group, summary_of, names)
        for group in groups
        if len({campaign.spec.seed for campaign in group}) > 1
    )
    return tuple(spread for spread in found if spread is not None)


def _make_spread(
    group: Group, summary_of: dict[int, Summary], names: dict[KeyPath, str]
) -> SeedSpread | None:
    members = _pick_members(group, summary_of)
    if not members:
        return None
    summaries = [member.summary for member in members]
    # Seeds of which no episode was completed may hide failures, too.
    known = {member.seed for member in members}
    lost = sum(each.counts.errored for each in group if each.spec.seed not in known)
    pooled = _pool_rates(members, lost)
    # Ties are broken by the first failure and then by the seed, so that the answer does not depend
    # on the order of the campaigns.
    worst = min(members, key=lambda member: (member.share, -member.first, member.seed))
    return SeedSpread(
        name=_name_group(group[0].spec, names),
        method=group[0].spec.method,
        campaigns=tuple(member.campaign.id for member in members),
        seeds=tuple(member.seed for member in members),
        completed=sum(summary.counts.completed for summary in summaries),
        failures=sum(summary.counts.failures for summary in summaries),
        share=measure_spread([member.share for member in members], 0.0, 1.0),
        worst=SeedValue(worst.seed, worst.campaign.id, worst.share),
        log_probability_per_step=_measure_known(
            [summary.log_probability_per_step for summary in summaries]
        ),
        mean_severity=_measure_known([summary.mean_severity for summary in summaries], 0.0),
        first=_find_first_failures(members),
        cost=_price_failures(members, pooled),
        notes=tuple(_list_notes(group, members, pooled)),
        pooled=pooled if pooled.sampled else None,
    )


def _pick_members(group: Group, summary_of: dict[int, Summary]) -> list[_Member]:
    """Return, by seed, the campaigns with a completed episode; only the furthest of each seed."""
    found: dict[int, _Member] = {}
    # The last one wins: of one seed that is the campaign with most episodes, then the newest.
    for campaign in sorted(group, key=lambda each: (summary_of[each.id].counts.completed, each.id)):
        if summary_of[campaign.id].counts.completed:
            found[campaign.spec.seed] = _Member(campaign, summary_of[campaign.id])
    return [found[seed] for seed in sorted(found)]


def _name_group(spec: CampaignSpec, names: dict[KeyPath, str]) -> str:
    if not names:
        return spec.method
    given = list_given_settings(spec)
    words = [f"{name}={_format(given[path])}" for path, name in names.items() if path in given]
    return ", ".join(words) or DEFAULTS


def _format(value: object) -> str:
    drawn = in_words({"": value}) if isinstance(value, dict) else {}
    return drawn.get("") or format_value(value)


def _measure_known(values: Sequence[float | None], lowest: float = -inf) -> SeedFigure | None:
    known = [value for value in values if value is not None]
    return measure_spread(known, lowest) if known else None


def _find_first_failures(members: Sequence[_Member]) -> FirstFailures:
    # A seed without a failure counts as infinitely many episodes, so the median is known if more
    # than half of the seeds have a failure.
    ordered = sorted(member.first for member in members)
    middle = len(ordered) // 2
    median = (ordered[middle] + ordered[-middle - 1]) / 2.0
    worst = max(members, key=lambda each: (each.first, each.summary.counts.completed, -each.seed))
    return FirstFailures(
        median=None if median == inf else median,
        worst=None if worst.first == inf else int(worst.first),
        worst_seed=worst.seed,
        without=ordered.count(inf),
        within=worst.summary.counts.completed,
    )


def _price_failures(members: Sequence[_Member], pooled: Rate) -> Cost:
    bills = [member.summary.cost for member in members]
    failures = [member.summary.counts.failures for member in members]
    return price_over_seeds(
        PairSums.of([bill.total_usd for bill in bills], failures),
        sum(bill.instance_hours for bill in bills),
        pooled,
    )


def _pool_rates(members: Sequence[_Member], lost: int) -> Rate:
    """Return the failure rate of all episodes of the members together.

    Args:
        members: campaigns with a completed episode.
        lost: errored episodes of seeds without a completed episode; each may hide a failure.
    """
    rates = [rate for member in members if (rate := member.summary.failure_rate)]
    return SamplingDesign.of([member.campaign.spec for member in members]).make_rate(
        sum(rate.k for rate in rates),
        sum(rate.n for rate in rates),
        sum(rate.errored for rate in rates) + lost,
        sum(rate.unresolved for rate in rates),
    )


def price_over_seeds(sums: PairSums, instance_hours: float, failures: Rate) -> Cost:
    """Return total price ÷ all failures with its interval across seeds, or a lower bound.

    If no seed has a failure, episodes that were drawn from p(x) bound the cost as in one campaign.
    Episodes of a search bound the cost by the number n of seeds. With 95 % confidence a seed finds
    failures with a probability of at most 1 − 0.05^(1/n). At worst, all episodes of such a seed
    fail.

    Args:
        sums: sums over the seeds of price [USD] and failures.
        instance_hours: instance hours of all seeds. [h]
        failures: failure rate over the episodes of all seeds.
    """
    if sums.failures:
        return Cost(sums.price, instance_hours, *find_ratio(sums))
    pooled = price_failures(sums.price, instance_hours, failures)
    if pooled.at_least_usd is not None:
        return pooled
    return replace(
        pooled,
        at_least_usd=sums.price / (failures.trials * find_upper_bound(0, sums.n, ERROR)) or None,
    )


def _list_notes(group: Group, members: Sequence[_Member], pooled: Rate) -> Iterator[str]:
    specs = [campaign.spec for campaign in group]
    design = SamplingDesign.of(specs)
    yield _describe_pooled_rate(pooled) if design.is_sampled else OF_THE_SEARCH
    counted = {member.seed for member in members}
    if missing := sorted({spec.seed for spec in specs} - counted):
        lost = ", ".join(map(str, missing))
        rest = len(counted)
        yield f"No episode is completed with seed {lost}: the figures are of the other {rest}."
    if repeated := len(group) - len({spec.seed for spec in specs}):
        yield f"Campaigns with the seed of another one are not counted twice: {repeated} left out."
    if unfinished := sum(member.campaign.state not in FINAL_STATES for member in members):
        yield f"{unfinished} of {len(members)} campaigns have not ended: figures may still change."
    lengths = [member.summary.counts.completed for member in members]
    if min(lengths) < max(lengths):
        yield (
            f"The seeds have {min(lengths):,} to {max(lengths):,} completed episodes; each counts "
            "alike in a mean."
        )


def _describe_pooled_rate(rate: Rate) -> str:
    """Describe the failure rate of all episodes together, which were all drawn from p(x)."""
    quoted = (
        f"All episodes were drawn from p(x): together their failure rate is "
        f"{format_counted_rate(rate)}. Quote this "
        "interval rather than that of the mean over seeds."
    )
    return f"{quoted} {explain_design(rate)}".rstrip()


def make_suite_table(store: Store, suite: str, most: int = suites.MOST_MEMBERS) -> SuiteTable:
    """Return the newest campaign of each member, with the settings that differ between members.

    Args:
        store: store of the campaigns.
        suite: its name.
        most: maximum number of rows; if there are more members, the ones with the newest campaigns
            are shown.

    Raises:
        NotFound: no campaign belongs to the suite.
    """
    campaigns = list(store.campaigns.iterate(CampaignFilter(suite=suite)))
    if not campaigns:
        raise NotFound(
            f"No campaign belongs to a suite '{suite}'.",
            "`eigenfail suite list` shows which suites there are.",
        )
    # Campaigns come newest first: reversed, the newest of each member overwrites the others.
    newest = {member_of(each.spec.name): each for each in reversed(campaigns)}
    shown = dict(sorted(newest.items(), key=lambda one: -one[1].id)[:most])
    members = [(name, shown[name]) for name in newest if name in shown]
    columns = suites.shorten_paths(list_differing([each.spec for _, each in members]))
    found = [each for _, each in members]
    summaries = summarise_campaigns(store, found)
    return SuiteTable(
        suite=suite,
        columns=tuple(columns.values()),
        members=tuple(
            _make_row(name, each, columns, summary)
            for (name, each), summary in zip(members, summaries, strict=True)
        ),
        earlier=len(campaigns) - len(newest),
        left_out=len(newest) - len(members),
        over_seeds=make_spreads(found, summaries),
    )


def _make_row(
    member: str, campaign: Campaign, columns: dict[suites.KeyPath, str], summary: Summary
) -> SuiteRow:
    given = list_given_settings(campaign.spec)
    return SuiteRow(
        member=member,
        campaign=campaign.id,
        state=campaign.state,
        stopped_because=campaign.stopped_because,
        settings={name: given[path] for path, name in columns.items() if path in given},
        summary=summary,
    )
