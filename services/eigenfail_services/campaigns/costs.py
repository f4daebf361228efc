"""Costs of campaigns and of methods, and figures for pages."""

from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextvars import copy_context
from typing import Any, NamedTuple

from eigenfail.values.analysis import FEWEST_OF_MODE, Analysis, AnalysisResult, AnalysisState
from eigenfail.values.campaign import Campaign
from eigenfail.values.operations import WorkerShare
from eigenfail.values.safety import Safety
from eigenfail.values.summary import CampaignCost, SpendingTotals
from eigenfail_services.analysis import campaign_figures
from eigenfail_services.campaigns import summary
from eigenfail_services.store.store import Store

MAX_ANALYSES_SEARCHED = 100
"""Newest analyses among which a finished one is searched for."""


def find_spending(store: Store, campaign: Campaign) -> CampaignCost:
    """Return the cost of a campaign, of its failures and modes, and the use of its time, so far."""
    spec, totals = campaign.spec, store.figures.spending(campaign.id)
    rate = summary.find_failure_rate(campaign, summary.count_unresolved(store, campaign))
    modes, cost = _find_known_modes(store, campaign), summary.find_cost(campaign, rate)
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
        per_mode_usd=summary.divide(cost.total_usd, count or 0),
        modes_in_words=modes.words,
        curve=tuple(campaign_figures.make_cost_curve(campaign, totals, modes)),
        time=campaign_figures.split_time(campaign, totals),
        notes=tuple(_list_approximations(campaign, totals)),
    )


def _list_approximations(campaign: Campaign, totals: SpendingTotals) -> Iterator[str]:
    if totals.progress:
        yield campaign_figures.BY_CLOCK
    if campaign_figures.has_unbilled_time(campaign, [each.at_ms for each in totals.progress]):
        yield campaign_figures.PAUSED


def _find_known_modes(store: Store, campaign: Campaign) -> campaign_figures.KnownModes:
    """Return the distinct modes that the newest finished analysis found among the failures."""
    found = find_newest(store, campaign)
    if found is None or found.result is None:
        words = f"No analysis is done: `eigenfail analyze {campaign.id}`, or Analyse on its page."
        return campaign_figures.KnownModes(None, None, words)
    result = found.result
    if not result.distinct:
        return campaign_figures.KnownModes(found.id, None, result.verdict)
    first = _find_first_failures(result, campaign.id)
    landed = (store.episodes.page(campaign.id, 1, after=index - 1).items for index in first)
    words = f"{result.verdict} {result.caution}".rstrip()
    owners = result.campaigns or (campaign.id,) * len(result.episodes)
    # The campaign may have gone on since.
    analysed, failures = owners.count(campaign.id), campaign.counts.failures
    if analysed < failures:
        words += f" It knows {analysed} of {failures} failures."
    return campaign_figures.KnownModes(
        found.id, tuple(sorted(rows[0].finished_ms for rows in landed)), words
    )


def find_newest(store: Store, campaign: Campaign) -> Analysis | None:
    """Return the newest finished analysis of a campaign; None before there is one.

    An analysis that was requested for another campaign and includes this one is not considered.
    """
    page = store.analyses.page(MAX_ANALYSES_SEARCHED, campaign=campaign.id)
    done = (each.id for each in page.items if each.state is AnalysisState.DONE)
    number = next(done, None)
    return None if number is None else store.analyses.get(number)


def _find_first_failures(result: AnalysisResult, campaign: int) -> list[int]:
    """Return the lowest index among the campaign's failures of each mode.

    A mode with too few failures to establish it is not counted, as in the verdict of the analysis.
    """
    owners = result.campaigns or (campaign,) * len(result.episodes)
    first: dict[int, int] = {}
    for owner, index, mode in zip(owners, result.episodes, result.labels, strict=True):
        if owner == campaign and result.modes[mode].failures >= FEWEST_OF_MODE:
            first[mode] = min(index, first.get(mode, index))
    return list(first.values())


# One thread for each sum that `prefetch_figures` starts.
AT_A_TIME = 3
POOL = ThreadPoolExecutor(AT_A_TIME, thread_name_prefix="figures")


class CampaignFigures(NamedTuple):
    """Safety, cost and workers of a campaign."""

    safety: Safety
    cost: CampaignCost
    workers: tuple[WorkerShare, ...]


def find_figures(store: Store, campaign: Campaign) -> CampaignFigures:
    """Return the figures of a campaign; the store's sums are computed side by side."""
    wait_for_figures(prefetch_figures(store, campaign))
    return read_figures(store, campaign)


def read_figures(store: Store, campaign: Campaign) -> CampaignFigures:
    """Return the figures of a campaign whose sums the store has computed before."""
    return CampaignFigures(
        summary.find_safety(store, campaign),
        find_spending(store, campaign),
        summary.find_worker_shares(store, campaign),
    )


def prefetch_figures(store: Store, campaign: Campaign) -> Sequence[Future[Any]]:
    """Start computing the sums that `find_figures` needs; the store caches them."""
    asked = (store.figures.safety, store.figures.spending, store.figures.workers)
    # `as_of` sets a context variable, and a thread of the pool sees it only in a copy of the
    # context.
    with store.figures.as_of(campaign):
        return [POOL.submit(copy_context().run, ask, campaign.id) for ask in asked]


def is_prefetched(begun: Sequence[Future[Any]]) -> bool:
    """Return whether all sums have been computed."""
    return all(each.done() and not each.exception() for each in begun)


def wait_for_figures(begun: Sequence[Future[Any]]) -> None:
    """Wait for all sums, failed ones too: reading the figures raises their errors."""
    wait(begun)
