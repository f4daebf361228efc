"""Estimates with intervals: rates, failure probabilities and costs; how well chains have mixed."""

from enum import StrEnum
from typing import Literal

import msgspec
from msgspec import structs


class Interval(msgspec.Struct, frozen=True):
    """A 95 % confidence interval."""

    low: float
    high: float


IMPORTANCE_SAMPLING = "importance sampling"


BY_MONTE_CARLO = "Monte Carlo"
"""Method of an estimate that is a share of draws from p(x)."""


ONE_REGION = (
    "Importance sampling from one Gaussian sees one failure region; others are missed, so the true "
    "probability may be larger. Its own random error is not taken off."
)


class Estimate(msgspec.Struct, frozen=True, kw_only=True):
    """Failure probability under p(x), as a learner estimated it after its last whole round.

    An estimate by importance sampling is a lower bound without an interval, whatever its stored
    form. The proposal follows one failure region. Neither the spread of the weights nor the
    agreement of several such estimates shows the share of missed regions.

    Attributes:
        by: method: "subset simulation", "mixture sampling", "importance sampling" or "Monte Carlo".
        episodes: number of episodes behind the estimate.
        probability: the estimate; None if an honest estimate does not exist: see `problem`.
        bound: "lower" if `probability` is only a lower bound, which `note` explains; None
            if it is an estimate of the probability itself.
        cv: coefficient of variation: standard error ÷ probability. For a lower bound, it is the
            random error of the bound, not the distance from the true probability.
        interval: 95 % interval; None for a lower bound.
        effective: effective sample size of weighted samples.
        problem: why the number is missing, and what to do; empty otherwise.
        note: limitations that neither the number nor its interval shows.
    """

    by: str
    episodes: int
    probability: float | None = None
    cv: float | None = None
    interval: Interval | None = None
    effective: float | None = None
    problem: str = ""
    note: str = ""
    bound: Literal["lower"] | None = None

    def bound_below(self, errored: int) -> "Estimate":
        """Return the estimate as a lower bound if some episodes of the campaign errored.

        Methods count an errored episode as safe, although it may hide a failure. A share of draws
        from p(x) does not change: its interval counts errored episodes as failures.

        Args:
            errored: number of errored episodes of the campaign.
        """
        if not errored or self.probability is None or self.by == BY_MONTE_CARLO:
            return self
        episodes = "1 episode" if errored == 1 else f"{errored:,} episodes"
        note = f"{episodes} errored and may hide failures, so that the probability may be larger."
        note = f"{note} {self.note}".rstrip()
        return structs.replace(self, bound="lower", interval=None, note=note)


class RateDesign(StrEnum):
    """How the number of trials behind a rate was set, which decides its estimate and interval.

    `fixed`: the number was fixed beforehand. The estimate is k ÷ n, with Wilson's interval.
    `failures`: a number of failures may have ended the trials. The estimate is unbiased, with the
    exact interval of that rule. `sequence`: any look at the results may have ended the trials. The
    estimate is k ÷ n, which is biased, with a confidence sequence, which holds at every look.
    """

    FIXED = "fixed"
    FAILURES = "failures"
    SEQUENCE = "sequence"


class Rate(msgspec.Struct, frozen=True):
    """A rate k of n, with its estimate and interval.

    An errored or unresolved episode may hide an event. The upper end of the interval counts such
    episodes as events; the lower end does not. The estimate leaves errored episodes out.

    Attributes:
        k: number of events among the completed episodes.
        n: number of completed episodes.
        value: the estimate; None if an unbiased estimate does not exist, as with the stop rule
            `failures = 1`.
        interval: 95 % interval of the design; one-sided for 0 and for n of n. None if the n
            episodes are not a random sample.
        sampled: whether the n episodes were drawn from p(x). A search chooses its episodes, so that
            their share does not estimate a probability, and does not get an interval.
        design: how the number of trials was set.
        errored: number of episodes that errored, not included in n.
        unresolved: number of episodes among the n that ended before what may have become an event.
    """

    value: float | None
    k: int
    n: int
    interval: Interval | None
    sampled: bool = True
    design: RateDesign = RateDesign.FIXED
    errored: int = 0
    unresolved: int = 0

    @property
    def trials(self) -> int:
        """Number of episodes that ended, errored ones included: what the interval rests on."""
        return self.n + self.errored

    @property
    def share(self) -> float:
        """k ÷ n, even if `value` is another estimate."""
        return self.k / self.n

    def __post_init__(self) -> None:
        if not self.sampled:
            # The episodes of an adaptive search are no random sample: there is nothing to bound.
            structs.force_setattr(self, "interval", None)


class Cost(msgspec.Struct, frozen=True):
    """The cost of a campaign.

    Attributes:
        total_usd: price per instance-hour × instance-hours.
        per_failure_usd: total ÷ failures; None without failures.
        interval_usd: interval of the cost per failure, from the interval of the failure rate or
            across seeds; None without failures, or if the interval is open above.
        at_least_usd: lower bound of the cost per failure (95 %), which also holds without failures.
    """

    total_usd: float
    instance_hours: float
    per_failure_usd: float | None
    interval_usd: Interval | None
    at_least_usd: float | None


class ProjectionMixing(msgspec.Struct, frozen=True):
    """How well chains mix, measured by a number that each of their failures has.

    Attributes:
        name: meaning of the number.
        r_hat: rank-normalized split R-hat; 1 if all chains have the same distribution, at most
            99.
        effective: bulk effective sample size: number of independent samples whose mean would be
            equally precise.
    """

    name: str
    r_hat: float
    effective: float


class ChainMixing(msgspec.Struct, frozen=True, kw_only=True):
    """How far the chains of a campaign of `chains` have mixed, after its last whole round.

    Attributes:
        campaign: id of the campaign.
        chains: number of chains.
        started: number of chains whose start failed; the others began at such a start.
        moves: number of completed moves after burn-in, over all chains.
        accepted: number of moves that failed, which is the number of accepted samples.
        first_sample: index of the first episode after burn-in.
        draws: number of states of each chain behind the projections.
        projections: mixing by projection, the largest R-hat first; empty until there are enough
            draws.
        mixed: whether all projections are within the bounds of `verdict`.
        verdict: whether the chains have mixed, with the reason, in words.
        remark: what the samples cannot show, in words.
    """

    campaign: int
    chains: int
    started: int
    moves: int
    accepted: int
    first_sample: int
    draws: int
    projections: tuple[ProjectionMixing, ...]
    mixed: bool
    verdict: str
    remark: str
