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
"""How an estimate was found that is a share of draws from p(x)."""


ONE_REGION = (
    "Importance sampling from one Gaussian sees one failure region; others are missed, so the true "
    "probability may be larger. Its own random error is not taken off."
)


class Estimate(msgspec.Struct, frozen=True, kw_only=True):
    """The failure probability under p(x), as a learner knows it after its last whole round.

    An estimate by importance sampling is a lower bound without an interval, whatever it was stored
    as: the proposal follows one failure region, and neither the spread of the weights nor the
    agreement of several such estimates shows the share of the regions that were missed.

    Attributes:
        by: how it was found: "subset simulation", "mixture sampling", "importance sampling" or
            "Monte Carlo".
        episodes: how many it rests on.
        probability: None if no honest estimate exists; `problem` then says why.
        bound: "lower" where `probability` is only a lower bound, which `note` explains; None
            if it is an estimate of the probability itself.
        cv: coefficient of variation: standard error ÷ probability. Of a lower bound it is the
            random error of the bound, not the distance from the true probability.
        interval: interval of 95 %; None of a lower bound.
        effective: effective sample size, of weighted samples.
        problem: why there is no number, and what to do; empty otherwise.
        note: what neither the number nor its interval can know.
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
        """Return the estimate of a campaign of which some episodes errored: a lower bound.

        Methods count an errored episode as no failure, although it may hide one. A share of draws
        from p(x) stays as it is: its interval counts them as failures.

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
    """How the number of trials behind a rate came about, which decides its estimate and interval.

    `fixed`: it was fixed beforehand: k ÷ n, and Wilson's interval. `failures`: a number of failures
    may have ended the trials: an estimate without bias, and the exact interval of that rule.
    `sequence`: the trials may have ended at any look at their results: k ÷ n, which is biased, and
    a confidence sequence, which holds at every look.
    """

    FIXED = "fixed"
    FAILURES = "failures"
    SEQUENCE = "sequence"


class Rate(msgspec.Struct, frozen=True):
    """k of n, with its estimate and interval.

    An errored episode and an unresolved one may hide an event. Both count as events in the upper
    end of the interval, and as none in the lower end. The estimate leaves errored episodes out.

    Attributes:
        k: number of events among the completed episodes.
        n: number of completed episodes.
        value: the estimate; None if there is none without bias, as with the stop rule
            `failures = 1`.
        interval: 95 % interval, as the design says; one-sided for 0 and for n of n. None if the
            n are no random sample.
        sampled: whether the n were drawn from p(x). The episodes of a search were not: it chose
            them, so that their share estimates no probability, and has no interval.
        design: how the number of trials came about.
        errored: number of episodes that errored, besides the n.
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
        """k ÷ n, also where `value` is another estimate."""
        return self.k / self.n

    def __post_init__(self) -> None:
        if not self.sampled:
            # The episodes of an adaptive search are no random sample: there is nothing to bound.
            structs.force_setattr(self, "interval", None)


class Cost(msgspec.Struct, frozen=True):
    """The cost of a campaign.

    Attributes:
        total_usd: price per instance-hour × instance-hours.
        per_failure_usd: total ÷ failures; None while there is none.
        interval_usd: interval of the cost per failure, from the interval of the failure rate or
            across seeds; None while there is no failure, and where it has no upper end.
        at_least_usd: lower bound of the cost per failure (95 %), which holds without failures too.
    """

    total_usd: float
    instance_hours: float
    per_failure_usd: float | None
    interval_usd: Interval | None
    at_least_usd: float | None


class ProjectionMixing(msgspec.Struct, frozen=True):
    """How well chains mix, by one number that each of their failures has.

    Attributes:
        name: what the number is.
        r_hat: rank-normalized split R-hat; 1 if all chains have the same distribution, at most
            99.
        effective: bulk effective sample size: number of independent samples whose mean is known as
            precisely.
    """

    name: str
    r_hat: float
    effective: float


class ChainMixing(msgspec.Struct, frozen=True, kw_only=True):
    """How far the chains of a campaign of `chains` have mixed, after its last whole round.

    Attributes:
        campaign: id of the campaign.
        chains: number of chains.
        started: number of chains whose start failed; the others began where these did.
        moves: number of moves after burn-in that were completed, of all chains.
        accepted: number of them that failed, which is that of the accepted samples.
        first_sample: index of the first episode after burn-in.
        draws: number of states of each chain that the projections are of.
        projections: by projection, those of the largest R-hat first; empty before there are enough
            draws.
        mixed: whether all of them are within the bounds of `verdict`.
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
