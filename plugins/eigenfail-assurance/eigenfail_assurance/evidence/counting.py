"""Recorded campaigns, recounted from their episodes, and their bounds of P(failure).

Only campaigns of `monte_carlo`, and estimates of `subset`, `mixture` and `splitting`, state a
probability; any other method chose its episodes. If a stop rule on failures ended a campaign, only
its lower bound is used. A campaign with the rule `half_width` gives no bounds.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from msgspec.structs import replace

from eigenfail.intervals import find_lower_bound, find_upper_bound
from eigenfail.presentation.figures import count_noun
from eigenfail.values.campaign import Campaign, CampaignState
from eigenfail.values.episode import Outcome
from eigenfail.values.estimates import Interval
from eigenfail_assurance.evidence.records import CampaignRecord, RecordedEpisode, read_episodes
from eigenfail_assurance.risk.confidence import RunEstimate
from eigenfail_assurance.sensor.anchors import bound_estimate, bound_sampled

MONTE_CARLO = "monte_carlo"
REPLAYING = frozenset({"replay", "nearest", "minimal"})
"""Methods whose episodes have the seeds of those that they replay, whatever their own seed."""
ESTIMATING = frozenset({"subset", "mixture", "splitting"})
"""Methods whose own estimate states a probability, with an approximate interval."""


@dataclass(frozen=True)
class CountedCampaign:
    """A campaign with its episodes, read once and counted."""

    record: CampaignRecord

    @property
    def campaign(self) -> Campaign:
        """The campaign as the service had it."""
        return self.record.campaign

    @cached_property
    def episodes(self) -> tuple[RecordedEpisode, ...]:
        """Its episodes in index order.

        Raises:
            InvalidValue: they cannot be read.
        """
        return read_episodes(self.record.table, f"campaigns/{self.campaign.id}.episodes.csv")

    @cached_property
    def outcomes(self) -> Mapping[int, Outcome]:
        """Outcomes of its episodes by index."""
        return {each.index: each.outcome for each in self.episodes}

    @cached_property
    def failures(self) -> int:
        """Number of failures."""
        return sum(each.outcome.is_failure for each in self.episodes)

    @cached_property
    def errored(self) -> int:
        """Number of errored episodes."""
        return sum(each.outcome is Outcome.ERRORED for each in self.episodes)

    @property
    def unresolved(self) -> int:
        """Number of safe episodes that may have ended before a failure, by the service's count."""
        return min(self.record.facts.unresolved, self.completed - self.failures)

    @property
    def completed(self) -> int:
        """Number of completed episodes."""
        return len(self.episodes) - self.errored

    @property
    def has_gaps(self) -> bool:
        """True if the indices of its episodes are not 0 to n − 1."""
        return bool(self.episodes) and self.episodes[-1].index != len(self.episodes) - 1

    @cached_property
    def counted(self) -> Campaign:
        """The campaign with counts taken from its episodes, not from the service."""
        counts = replace(
            self.campaign.counts,
            completed=self.completed,
            failures=self.failures,
            errored=self.errored,
        )
        return replace(self.campaign, counts=counts)


Counted = Mapping[int, CountedCampaign]


def sum_failures(campaigns: Sequence[CountedCampaign]) -> int:
    """Return the number of failures of campaigns together."""
    return sum(each.failures for each in campaigns)


def sum_errored(campaigns: Sequence[CountedCampaign]) -> int:
    """Return the number of errored episodes of campaigns together."""
    return sum(each.errored for each in campaigns)


def sum_unresolved(campaigns: Sequence[CountedCampaign]) -> int:
    """Return the number of unresolved episodes of campaigns together."""
    return sum(each.unresolved for each in campaigns)


def sum_completed(campaigns: Sequence[CountedCampaign]) -> int:
    """Return the number of completed episodes of campaigns together."""
    return sum(each.completed for each in campaigns)


def explain_no_probability(campaigns: Sequence[CountedCampaign]) -> str:
    """Return why campaigns state no probability together; empty if they state one."""
    for each in campaigns:
        if each.campaign.state is not CampaignState.DONE or not each.completed:
            came = f"campaign {each.campaign.id} is {each.campaign.state_word}"
            return f"{came}, with {count_noun(each.completed, 'completed episode')}."
    if not campaigns:
        return "no campaign is named."
    if problem := explain_gaps(campaigns):
        return problem
    if all(each.campaign.spec.method == MONTE_CARLO for each in campaigns):
        return _explain_stop_rules(campaigns)
    if len(campaigns) > 1:
        return "only campaigns of 'monte_carlo' are counted together."
    return _explain_no_estimate(campaigns[0].campaign)


def explain_gaps(campaigns: Sequence[CountedCampaign]) -> str:
    """Return which campaign lacks episodes before its last one; empty if none does."""
    for each in campaigns:
        if each.has_gaps:
            # Only a rule on time or cost leaves gaps, and a failure often ends an episode early.
            return (
                f"campaign {each.campaign.id} lacks episodes before its last one, and whether an "
                "episode was completed in time may depend on how it ended."
            )
    return ""


def _explain_stop_rules(campaigns: Sequence[CountedCampaign]) -> str:
    for each in campaigns:
        stop = each.campaign.spec.stop
        if stop.half_width is not None or (len(campaigns) > 1 and stop.judges_failures):
            return (
                f"a stop rule on failures may have ended campaign {each.campaign.id}: "
                "the exact bound is that of a fixed number of episodes."
            )
    return ""


def _explain_no_estimate(campaign: Campaign) -> str:
    method, estimate = campaign.spec.method, campaign.estimate
    if method not in ESTIMATING:
        return (
            f"campaign {campaign.id} is of '{method}', which chose its episodes: their failures "
            "state no probability."
        )
    if estimate is None or estimate.probability is None:
        because = estimate.problem if estimate else "it gave none."
        return f"campaign {campaign.id} has no estimate: {because}"
    if RunEstimate.of(estimate) is None:
        return f"the estimate of campaign {campaign.id} has no interval. {estimate.note}".strip()
    return ""


def bound_probability(campaigns: Sequence[CountedCampaign], error: float) -> Interval:
    """Return one-sided bounds of P(failure), each with this error.

    Bounds are exact for episodes drawn from p(x) (Clopper and Pearson 1934, Biometrika 26,
    404–413), and log-normal for an estimate; see `eigenfail_assurance.sensor.anchors`. Errored and
    unresolved episodes that were drawn from p(x) count as failures in the upper bound.

    Args:
        campaigns: campaigns that state a probability, see `explain_no_probability`.
        error: probability that a bound does not hold.
    """
    first = campaigns[0].counted
    if first.spec.method != MONTE_CARLO and first.estimate is not None:
        return bound_estimate(first.estimate, error)
    if len(campaigns) == 1:
        return bound_sampled(first, error, campaigns[0].unresolved)
    failures, errored = sum_failures(campaigns), sum_errored(campaigns)
    trials = sum_completed(campaigns) + errored
    return Interval(
        find_lower_bound(failures, trials, error),
        find_upper_bound(failures + errored + sum_unresolved(campaigns), trials, error),
    )


def estimate_probability(campaigns: Sequence[CountedCampaign]) -> float | None:
    """Return the point estimate; None if a stop rule makes k ÷ n invalid."""
    first = campaigns[0].campaign
    if first.spec.method != MONTE_CARLO:
        return first.estimate.probability if first.estimate else None
    if is_ended_by_failures(campaigns):
        return None
    return sum_failures(campaigns) / sum_completed(campaigns)


def is_ended_by_failures(campaigns: Sequence[CountedCampaign]) -> bool:
    """Return whether the stop rule `failures` ended one of the campaigns."""
    limits = [(each.campaign.spec.stop.failures, each.failures) for each in campaigns]
    return any(limit is not None and failures >= limit for limit, failures in limits)
