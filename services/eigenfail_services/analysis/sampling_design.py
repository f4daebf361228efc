"""Choice of the estimator of a failure rate, by the design of the episodes."""

from collections.abc import Sequence
from typing import NamedTuple

from msgspec.structs import replace

from eigenfail.errors import EigenfailError
from eigenfail.intervals import bound_both_sides
from eigenfail.methods import describe_method, traits_of
from eigenfail.values.campaign import Campaign
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.estimates import Interval, Rate, RateDesign
from eigenfail_services.statistics.intervals import bound_sequence, clopper_pearson, rate
from eigenfail_services.statistics.stopped_trials import StoppedTrials

MOST_AHEAD = 1
"""Rounds that are open besides the oldest one, at most, where a rule judges their results."""

RULE_HELD = "(rule: failures = "
OPEN_WAS_FINISHED = "The round that was open was finished."
"""How `Campaign.stopped_because` names the rule `failures`, and the round after its last look."""


class SamplingDesign(NamedTuple):
    """The design of campaigns' episodes, which decides on the estimator of their rates.

    All figures take their estimates and intervals from this class.

    Attributes:
        methods: methods of the campaigns. The episodes are a random sample only if all methods draw
            noise from p(x).
        judges_failures: whether a stop rule on failures may have ended a campaign. The number of
            episodes is then not fixed, so neither k ÷ n nor Wilson's interval holds.
        ends: how the rule `failures` ended the episodes of one campaign, if it is known.
    """

    methods: tuple[str, ...]
    judges_failures: bool = False
    ends: StoppedTrials | None = None

    @classmethod
    def of(cls, specs: Sequence[CampaignSpec]) -> "SamplingDesign":
        """Return the design of campaigns whose episodes are counted together.

        The design also covers events other than failures in one campaign. An exact design is not
        known for them, but a confidence sequence holds at the end of any campaign.
        """
        judges = any(spec.stop.judges_failures for spec in specs)
        return cls(tuple(spec.method for spec in specs), judges)

    @classmethod
    def of_failures(cls, campaigns: Sequence[Campaign]) -> "SamplingDesign":
        """Return the design of the failures in all episodes of one or several campaigns."""
        design = cls.of([campaign.spec for campaign in campaigns])
        if len(campaigns) == 1 and design.judges_failures and design.is_sampled:
            return design._replace(ends=find_end(campaigns[0]))
        return design

    def make_rate(self, k: int, n: int, errored: int = 0, unresolved: int = 0) -> Rate:
        """Return the rate of k in n episodes with a valid interval; without interval for a search.

        Args:
            k: number of events.
            n: number of completed episodes.
            errored: number of errored episodes besides the n; each may hide an event.
            unresolved: number of the n that ended before a possible event. At most n - k count,
                because this number may have been read after k and n.

        Raises:
            InvalidValue: n is 0, or not 0 <= k <= n.
        """
        unresolved = min(unresolved, n - k)
        fixed = rate(k, n, errored, unresolved)
        if not self.is_sampled:
            return replace(fixed, interval=None, sampled=False)
        if not self.judges_failures:
            return fixed
        if self.ends and self.ends.trials == n and self.ends.allows_doubt(fixed):
            return _make_stopped_rate(self.ends, fixed)
        interval = bound_sequence(k, fixed.trials, errored + unresolved)
        return replace(fixed, interval=interval, design=RateDesign.SEQUENCE)

    def find_bounds(self, found: Rate) -> Interval:
        """Return the two-sided interval of a rate, even if all episodes ended alike.

        The upper end counts errored and unresolved episodes as events, as in `make_rate`.
        """
        doubtful = found.errored + found.unresolved
        if not self.judges_failures:
            return bound_both_sides(found)
        if self.ends and self.ends.trials == found.n and self.ends.allows_doubt(found):
            return _bound_stopped(self.ends, found)
        return bound_sequence(found.k, found.trials, doubtful)

    @property
    def is_sampled(self) -> bool:
        """True if all episodes are drawn from p(x)."""
        return all(traits_of(method).draws_from_prior for method in self.methods)


def _make_stopped_rate(ends: StoppedTrials, fixed: Rate) -> Rate:
    # Where all episodes ended alike, all 5 % are spent on the one side that is open, as elsewhere.
    doubtful = fixed.errored + fixed.unresolved
    one_sided = fixed.k == 0 or fixed.k + doubtful >= fixed.trials
    return replace(
        fixed,
        value=ends.estimate(fixed.k),
        interval=fixed.interval if one_sided else _bound_stopped(ends, fixed),
        design=RateDesign.FAILURES,
    )


def _bound_stopped(ends: StoppedTrials, found: Rate) -> Interval:
    """Return the exact bounds of a rate under the rule `failures`; see `allows_doubt`."""
    doubtful = found.errored + found.unresolved
    if not doubtful:
        return ends.find_bounds(found.k)
    # The rule did not hold, so that the number of trials is a fixed one.
    most = min(found.k + doubtful, found.trials)
    low = clopper_pearson(found.k, found.trials).low
    return Interval(low, clopper_pearson(most, found.trials).high)


def find_end(campaign: Campaign) -> StoppedTrials | None:
    """Return how the rule `failures` ended the episodes of a campaign so far.

    None if the end is unknown, which is always so if a second rule judges failures. With enough
    failures, it is also unknown if the size of the rounds is unknown, if the end is still to come,
    or if episodes errored: they leave fewer completed episodes in the rounds.
    """
    limit, counts = campaign.spec.stop.failures, campaign.counts
    if limit is None or campaign.spec.stop.half_width is not None:
        return None
    if counts.failures < limit:
        # The estimate and the interval are those of a fixed number, wherever the looks were.
        return StoppedTrials(limit, 0, 0, counts.completed)
    rounds = _find_rounds(campaign.spec)
    return None if rounds is None or counts.errored else _place_end(campaign, limit, *rounds)


def _place_end(campaign: Campaign, limit: int, size: int, ahead: int) -> StoppedTrials | None:
    completed, because = campaign.counts.completed, campaign.stopped_because
    if RULE_HELD in because:
        late = size if OPEN_WAS_FINISHED in because else 0
        early = completed - late - size
        return StoppedTrials(limit, early, size, late) if early >= 0 else None
    if completed < campaign.spec.episodes:
        return None
    # The rule was not judged any more once the last round was open.
    early = max((completed - 1) // size - ahead, 0) * size
    return StoppedTrials(limit, early, 0, completed - early)


def _find_rounds(spec: CampaignSpec) -> tuple[int, int] | None:
    """Return the size of a campaign's rounds, and the number of open rounds besides the oldest."""
    try:
        description = describe_method(spec.method)
        settings = description.read_settings(spec.settings, "settings")
        sizes = description.find_round_sizes(settings, spec.episodes)
    except EigenfailError:  # not installed here any more, or with other settings
        return None
    # The looks of the rule are known only where all rounds have one size.
    if sizes is None or sizes.first != sizes.later:
        return None
    return sizes.later, min(description.lookahead, MOST_AHEAD)
