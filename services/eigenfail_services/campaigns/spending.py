"""What a campaign cost and what that bought, from what the store holds of it."""

from collections.abc import Iterator

from eigenfail.contracts import Store
from eigenfail.values import (
    Analysis,
    AnalysisResult,
    AnalysisState,
    Campaign,
    CampaignCost,
    SpendingTotals,
)
from eigenfail_services.analysis.spending import (
    BY_CLOCK,
    PAUSED,
    KnownModes,
    curve,
    time_split,
    was_cut,
)
from eigenfail_services.campaigns.summary import campaign_cost, ratio

LOOKED_AT = 100
"""Among how many of the newest analyses one is looked for that is done."""


def spending_of(store: Store, campaign: Campaign) -> CampaignCost:
    """The bill, what failures and modes cost, and what the time went into, so far."""
    spec, totals = campaign.spec, store.episodes.spending(campaign.id)
    modes, cost = known_modes(store, campaign), campaign_cost(campaign)
    count = None if modes.found_ms is None else len(modes.found_ms)
    return CampaignCost(
        campaign=campaign.id,
        name=spec.name,
        method=spec.method,
        price_usd_per_hour=spec.price_usd_per_hour,
        instances=spec.instances,
        completed=campaign.counts.completed,
        failures=campaign.counts.failures,
        cost=cost,
        analysis=modes.analysis,
        modes=count,
        per_mode_usd=ratio(cost.total_usd, count or 0),
        modes_in_words=modes.words,
        curve=tuple(curve(campaign, totals, modes)),
        time=time_split(campaign, totals),
        notes=tuple(notes(campaign, totals)),
    )


def notes(campaign: Campaign, totals: SpendingTotals) -> Iterator[str]:
    """What is approximate."""
    if totals.landings:
        yield BY_CLOCK
    if was_cut(campaign, [landing.at_ms for landing in totals.landings]):
        yield PAUSED


def known_modes(store: Store, campaign: Campaign) -> KnownModes:
    """The distinct modes that the newest analysis that is done found among its failures."""
    found = newest(store, campaign)
    if found is None or found.result is None:
        words = f"No analysis is done: `eigenfail analyze {campaign.id}`, or Analyse on its page."
        return KnownModes(None, None, words)
    result = found.result
    if not result.distinct:
        return KnownModes(found.id, None, result.verdict)
    first = first_failures(result, campaign.id)
    landed = (store.episodes.page(campaign.id, 1, after=index - 1).items for index in first)
    words = f"{result.verdict}{behind(result, campaign)}"
    return KnownModes(found.id, tuple(sorted(rows[0].finished_ms for rows in landed)), words)


def newest(store: Store, campaign: Campaign) -> Analysis | None:
    """The newest analysis of a campaign that is done."""
    page = store.analyses.page(LOOKED_AT, campaign=campaign.id)
    done = (each.id for each in page.items if each.state is AnalysisState.DONE)
    number = next(done, None)
    return None if number is None else store.analyses.get(number)


def first_failures(result: AnalysisResult, campaign: int) -> list[int]:
    """The lowest index among a campaign's failures in each of the modes that has one."""
    owners = result.campaigns or (campaign,) * len(result.episodes)
    first: dict[int, int] = {}
    for owner, index, mode in zip(owners, result.episodes, result.labels, strict=True):
        if owner == campaign:
            first[mode] = min(index, first.get(mode, index))
    return list(first.values())


def behind(result: AnalysisResult, campaign: Campaign) -> str:
    """That failures came after the analysis, if some did."""
    owners = result.campaigns or (campaign.id,) * len(result.episodes)
    known, now = owners.count(campaign.id), campaign.counts.failures
    return f" It knows {known} of {now} failures." if known < now else ""
