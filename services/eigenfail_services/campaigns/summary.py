"""Figures of one campaign: result row, safety, course, workers, newest policy, chain mixing."""

from collections.abc import Sequence

import structlog

from eigenfail import plugins
from eigenfail.errors import Conflict, InputError, NotFound
from eigenfail.methods import NarrowCampaign, find_narrow_campaigns
from eigenfail.presentation.rates import explain_design
from eigenfail.values.campaign import FINAL_STATES, Campaign, CampaignFilter, CampaignState
from eigenfail.values.estimates import ChainMixing, Cost, Rate
from eigenfail.values.learning import Policy
from eigenfail.values.operations import Event, Presence, Staffing, WorkerShare
from eigenfail.values.records import ConflictTotals, FrequentFault, Totals
from eigenfail.values.safety import TAIL_LEVEL, Safety
from eigenfail.values.summary import Conflicts, Course, Errored, MeanTime, Summary, Unresolved
from eigenfail_services.analysis import campaign_figures
from eigenfail_services.analysis.sampling_design import SamplingDesign
from eigenfail_services.campaigns.rounds import read_checkpoint
from eigenfail_services.hub.worker_table import WORKERS_LACKING, WORKERS_MET
from eigenfail_services.methods import Mixing, describe_reach
from eigenfail_services.resolution import find_searching, resolve_method
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.errors import make_episode_error
from eigenfail_services.store.roster import PRESENT_S
from eigenfail_services.store.store import Store

log = structlog.get_logger()


def summarise(campaign: Campaign, totals: Totals) -> Summary:
    """Return the row of a campaign in result tables: findings, speed and price so far.

    Rate and cost use the campaign's counts, and means use the totals. While a campaign runs, the
    two may have been read a few results apart.
    """
    unresolved = Unresolved(totals.conflicts.unresolved, campaign.form.horizon_s)
    completed, rate = campaign.counts.completed, find_failure_rate(campaign, unresolved.count)
    return Summary(
        campaign=campaign.id,
        name=campaign.spec.name,
        method=campaign.spec.method,
        counts=campaign.counts,
        failure_rate=rate,
        mean_log_probability=divide(totals.log_probability, totals.failures),
        log_probability_per_step=divide(totals.log_probability, totals.steps),
        mean_severity=divide(totals.severity, totals.conflicts.collisions),
        episodes_per_s=divide(completed, campaign.active_s),
        cost=find_cost(campaign, rate),
        conflicts=summarise_conflicts(totals.conflicts),
        estimate=campaign.estimate,
        unresolved=unresolved,
        errored=_describe_errored(campaign, totals.fault),
        reach=_find_reach(campaign),
        rate_note=explain_design(rate) if rate else "",
        first_failure=totals.first_failure,
    )


def summarise_campaign(store: Store, campaign: Campaign) -> Summary:
    """Return the current summary of a campaign."""
    return summarise_campaigns(store, [campaign])[0]


def summarise_campaigns(store: Store, campaigns: Sequence[Campaign]) -> list[Summary]:
    """Return the summaries of campaigns in their order, with one query for all."""
    totals = store.figures.totals([campaign.id for campaign in campaigns])
    return [summarise(campaign, totals[campaign.id]) for campaign in campaigns]


def summarise_conflicts(totals: ConflictTotals) -> Conflicts:
    """Return the number of episodes by class, and the means of their lead times."""
    return Conflicts(
        unavoidable=totals.unavoidable,
        planner_failures=totals.planner_failures,
        unclassified=totals.unclassified,
        near_misses=totals.near_misses,
        allowed=totals.allowed,
        ttc_lead=MeanTime(divide(totals.ttc_lead_s, totals.ttc_leads), totals.ttc_leads),
        drac_lead=MeanTime(divide(totals.drac_lead_s, totals.drac_leads), totals.drac_leads),
    )


def count_unresolved(store: Store, campaign: Campaign) -> int:
    """Return the number of a campaign's episodes that are unresolved."""
    return store.figures.totals([campaign.id])[campaign.id].conflicts.unresolved


def _describe_errored(campaign: Campaign, fault: FrequentFault | None) -> Errored:
    """Return the number of errored episodes with their most frequent reason."""
    count = campaign.counts.errored
    if not count or fault is None:
        return Errored(count)
    return Errored(count, fault.kind, fault.message, min(fault.episodes, count), fault.first)


def _find_reach(campaign: Campaign) -> str:
    """Return where failures may be that the method cannot reach; empty unless it ended without any.

    Also empty if the method is not installed any more.
    """
    spec, counts = campaign.spec, campaign.counts
    if counts.failures or not counts.completed or campaign.state not in FINAL_STATES:
        return ""
    try:
        return describe_reach(find_searching(resolve_method(spec.method, spec.settings)).settings)
    except InputError:
        return ""
    # What a plug-in of today raises for a campaign of yesterday must not cost its summary.
    except Exception:
        log.exception("reach not known", method=spec.method)
        return ""


def find_failure_rate(campaign: Campaign, unresolved: int) -> Rate | None:
    """Return the failure rate of the completed episodes; None before the first one.

    Args:
        campaign: the campaign with its current counts.
        unresolved: number of its episodes that are, or may be, unresolved.
    """
    counts = campaign.counts
    if not counts.completed:
        return None
    design = SamplingDesign.of_failures([campaign])
    return design.make_rate(counts.failures, counts.completed, counts.errored, unresolved)


def find_cost(campaign: Campaign, failures: Rate | None = None) -> Cost:
    """Return the cost of a campaign's instances while it was running.

    Args:
        campaign: the campaign with its current counts.
        failures: its failure rate; None if only the bill is needed.
    """
    active_s = campaign.active_s
    hours = campaign_figures.sum_instance_hours(campaign, active_s)
    return campaign_figures.price_failures(
        campaign_figures.bill_usd(campaign, active_s), hours, failures
    )


def divide(amount: float | None, per: float) -> float | None:
    """Return the quotient; None without an amount or with a divisor of 0."""
    return None if amount is None or not per else amount / per


def find_safety(store: Store, campaign: Campaign, level: float = TAIL_LEVEL) -> Safety:
    """Return the safety table of the episodes so far.

    Raises:
        InvalidValue: the level is not between 0 and 1.
    """
    totals = store.figures.totals([campaign.id])[campaign.id]
    measured = store.figures.safety(campaign.id)
    # The intervals of VaR and CVaR take longer than everything else on a page that shows them.
    return store.answers.get(
        ("safety table", campaign.id, level),
        (campaign.counts, totals, measured.completed),
        lambda: campaign_figures.make_safety(
            campaign,
            measured,
            summarise_conflicts(totals.conflicts),
            Unresolved(totals.conflicts.unresolved, campaign.form.horizon_s),
            level,
        ),
    )


def find_course(store: Store, campaign: Campaign, per: int | None = None) -> Course:
    """Return failures, likelihood and robustness block by block over the episodes so far.

    Args:
        store: store with the episodes.
        campaign: the campaign with its current counts.
        per: how many indices a block spans; None chooses by the budget.

    Raises:
        InvalidValue: blocks of this length would be too many.
    """
    length = campaign_figures.choose_block_length(campaign.counts, per)
    return campaign_figures.make_course(campaign, length, store.figures.course(campaign.id, length))


MAX_EVENTS_SEARCHED = 200
"""Newest events among which the last one about workers is searched for."""


WORDS = frozenset({"workers.asked", "workers.refused", "ray.lost", "ray.back", "ray.machines"})
"""Kinds of events about workers that the services start."""


OUTLOOK = frozenset({WORKERS_LACKING, WORKERS_MET, "campaign.state", "campaign.progress"})
"""Kinds of events after which a campaign goes on, or waits for another worker than there is."""


LATELY_S = 600


def find_worker_shares(store: Store, campaign: Campaign) -> tuple[WorkerShare, ...]:
    """Return the workers that ran the episodes of a campaign; the busiest comes first."""
    return store.figures.workers(campaign.id)


def list_recent_workers(store: Store, within_s: int = LATELY_S) -> tuple[WorkerShare, ...]:
    """Return the workers that delivered results in the last `within_s`, with their counts."""
    return store.figures.workers_since(now_ms() - 1_000 * within_s)


def count_present(store: Store) -> tuple[Presence, ...]:
    """Return the workers that are connected to a hub now, by name."""
    return store.roster.present(now_ms() - 1_000 * PRESENT_S)


def list_unrunnable(store: Store) -> tuple[Event, ...]:
    """Return the newest event of each running campaign that no connected worker can run."""
    return tuple(event for event in store.events.newest(OUTLOOK) if event.kind == WORKERS_LACKING)


MOST_RUNNING = 1_000
"""Most running campaigns that are read; if more run, no width is reported."""


def find_narrow(store: Store, campaign: Campaign, workers: int) -> tuple[NarrowCampaign, ...]:
    """Return the campaign, if it runs and some workers are idle since it is too narrow."""
    if campaign.state is not CampaignState.RUNNING:
        return ()
    running = store.campaigns.page(MOST_RUNNING, where=CampaignFilter(state=CampaignState.RUNNING))
    if running.next is not None:
        return ()
    narrow = find_narrow_campaigns(running.items, workers)
    return tuple(each for each in narrow if each.campaign == campaign.id)


def find_staffing(store: Store) -> Staffing:
    """Return the number of workers, the newest event on them, and unrunnable campaigns."""
    return make_staffing(store, len(count_present(store)), list_unrunnable(store))


def make_staffing(store: Store, workers: int, lacking: tuple[Event, ...]) -> Staffing:
    """Return the staffing for a number of workers and unrunnable campaigns that were read before.

    Only a few events are read: without workers, hardly any events are of another kind.
    """
    for event in store.events.latest(MAX_EVENTS_SEARCHED):
        if event.kind in WORDS:
            return Staffing(
                workers=workers, said=event.message, said_ms=event.at_ms, stranded=lacking
            )
    return Staffing(workers=workers, stranded=lacking)


def find_worker(store: Store, campaign: int, index: int) -> Presence:
    """Return the worker whose result of an episode was accepted, as it was at that time.

    Raises:
        NotFound: no such episode, or nothing is known of its worker any more.
    """
    row = next(iter(store.episodes.page(campaign, 1, index - 1 if index else None).items), None)
    if row is None or row.index != index:
        raise make_episode_error(campaign, index)
    if (found := store.roster.last(row.worker, row.finished_ms)) is None:
        problem = f"No record exists of the worker '{row.worker}' of episode {campaign}/{index}."
        raise NotFound(problem, "Workers are written down when they connect to a hub.")
    return found


def find_newest_policy(store: Store, campaign: Campaign) -> Policy:
    """Return the newest policy that a campaign's workers were given.

    Raises:
        NotFound: the workers were not given a policy, or not yet.
        ProtocolError: a newer program wrote the checkpoint.
    """
    state = store.checkpoints.load(campaign.id)
    policy = read_checkpoint(state).policy if state else None
    if policy is None:
        raise NotFound(
            f"Campaign {campaign.id} of method '{campaign.spec.method}' has no policy.",
            "A policy is what 'ast' trains; it is there once the first round is in.",
        )
    return policy


def find_chain_mixing(store: Store, campaign: Campaign) -> ChainMixing:
    """Return how far the chains of a campaign have mixed.

    Raises:
        Conflict: the campaign's method is not installed or does not use chains, or the campaign has
            not finished a round.
        InvalidValue: the method cannot be loaded.
        ProtocolError: its checkpoint cannot be read.
    """
    name = campaign.spec.method
    # A campaign outlives the package of its method, and its page still shows everything else.
    if name not in plugins.names(plugins.METHODS):
        problem = f"Campaign {campaign.id} is one of {name}, which is not installed here."
        raise Conflict(problem, "Install the package of the method where the service runs.")
    method = plugins.load(plugins.METHODS, name)
    if not isinstance(method, Mixing):
        problem = f"Campaign {campaign.id} is one of {name}, which has no chains."
        raise Conflict(problem, "Launch one of chains that starts from its failures.")
    checkpoint = store.checkpoints.load(campaign.id)
    state = read_checkpoint(checkpoint).learner if checkpoint else None
    found = None if state is None else method.judge_mixing(campaign, state)
    if found is None:
        problem = f"No chain of campaign {campaign.id} has started. {campaign.stopped_because}"
        raise Conflict(problem.strip(), "Its first round runs the starts.")
    return found
