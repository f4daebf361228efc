"""Two groups of campaigns, A and B, side by side."""

from enum import StrEnum

import msgspec

from eigenfail.settings import Count
from eigenfail.values.campaign_spec import Settings
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.estimates import Cost, Interval, Rate
from eigenfail.values.requirements import Requirements
from eigenfail.values.showing import Brief, Shown


class PairTotals(msgspec.Struct, frozen=True):
    """Pairs of completed episodes of equal index, seed and kind of source, by their outcomes."""

    both: int = 0
    only_first: int = 0
    only_second: int = 0
    neither: int = 0

    @property
    def n(self) -> int:
        """How many pairs."""
        return self.both + self.only_first + self.only_second + self.neither


class Side(msgspec.Struct, frozen=True, kw_only=True):
    """The findings of the campaigns of one side, taken together.

    Attributes:
        campaigns: their ids, one for each seed.
        completed: episodes.
        failures: failures among them.
        failure_rate: failure rate with its interval; None before the first episode.
        rates: the failure rate of each campaign; None before its first episode.
        log_probability_per_step: log-probability per step of the failures: sum of log p over all
            their steps ÷ steps.
        mean_severity: mean severity of the failures [m²/s²].
        cost: cost of all campaigns together, per failure of any.
    """

    campaigns: tuple[int, ...]
    completed: int
    failures: int
    failure_rate: Rate | None
    rates: tuple[float | None, ...]
    log_probability_per_step: float | None
    mean_severity: float | None
    cost: Cost


class Difference(msgspec.Struct, frozen=True):
    """Failure rate of B minus that of A, as shares of one.

    Attributes:
        interval: Tango's score interval of paired samples, or Newcombe's hybrid score interval of
            independent ones; of searches as if their episodes were a sample, which they are not: a
            rule of the gate, and not to be quoted.
        n_a: completed episodes of A that the rate rests on.
        n_b: the same of B.
        is_paired: whether the rates are of pairs of episodes with the same noise.
    """

    value: float
    interval: Interval
    n_a: Count
    n_b: Count
    is_paired: bool = False


class McNemar(msgspec.Struct, frozen=True):
    """McNemar's exact test on paired episodes: whether one side fails where the other does not.

    Attributes:
        n: pairs.
        both: pairs in which both sides failed.
        only_a: pairs in which only A failed.
        only_b: pairs in which only B failed.
        neither: pairs in which none failed.
        p_value: two-sided.
    """

    n: int
    both: int
    only_a: int
    only_b: int
    neither: int
    p_value: float


class Magnitude(StrEnum):
    """How large an effect is called (Vargha and Delaney 2000)."""

    NEGLIGIBLE = "negligible"
    SMALL = "small"
    MEDIUM = "medium"
    LARGE = "large"


class EffectSize(msgspec.Struct, frozen=True):
    """Vargha and Delaney's A12 over campaigns, by failure rate.

    Attributes:
        a12: the probability that a campaign of B has a higher failure rate than one of A, ties
            counted half.
        n_a: campaigns of A.
        n_b: campaigns of B.
    """

    a12: float
    magnitude: Magnitude
    n_a: int
    n_b: int


class Distinction(msgspec.Struct, frozen=True):
    """A thing in which the two sides were not asked for the same, in words."""

    thing: str
    a: str
    b: str


class Comparison(Brief, Shown, msgspec.Struct, frozen=True, kw_only=True):
    """Two groups of campaigns, side by side.

    Attributes:
        difference: None before both have completed an episode.
        pairs: None if episodes are not paired.
        unpaired_because: why not, in words; empty if they are.
        effect: None with so few campaigns that even full separation could be chance.
        distinctions: settings in which the sides differ.
        sentences: summary of the comparison, one sentence per finding.
        warnings: limitations of the result.
    """

    a: Side
    b: Side
    difference: Difference | None
    pairs: McNemar | None
    unpaired_because: str
    effect: EffectSize | None
    distinctions: tuple[Distinction, ...]
    sentences: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def is_sampled(self) -> bool:
        """Whether the episodes of both sides are random samples, whose rates can be compared."""
        rates = (self.a.failure_rate, self.b.failure_rate)
        return all(rate is not None and rate.sampled for rate in rates)


class Peers(msgspec.Struct, frozen=True, kw_only=True):
    """The fields that campaigns with comparable costs have in common.

    Attributes:
        planner_settings: settings that differ from the planner's defaults.
        scenario_parameters: the same of the scenario, each a value or a distribution.
        requirements: what an episode must satisfy; None: no collision.
    """

    planner: str
    planner_settings: Settings
    scenario: str
    scenario_parameters: Settings
    simulator: str
    disturbance: DisturbanceModel
    requirements: Requirements | None = None


class Pool(msgspec.Struct, frozen=True, kw_only=True):
    """The campaigns of one method among such peers, as sums.

    Attributes:
        campaigns: how many there are.
        newest: the id of the newest one.
        completed: episodes.
        failures: failures among them.
        errored: number of episodes that errored.
        unresolved: number of episodes that are unresolved.
        judges_failures: whether a stop rule of one of the campaigns judges failures.
        instance_hours: instance-hours of all campaigns. [h]
        total_usd: total cost of all campaigns. [USD]
        seeds: number of campaigns with a completed episode, if these differ in name, priority and
            seed alone, each with its own seed, and the others cost nothing; otherwise 0.
        usd_squares: sum of the squared costs of campaigns. [USD²]
        failure_squares: sum of the squared numbers of failures.
        usd_failures: sum of cost × failures. [USD]
    """

    peers: Peers
    method: str
    campaigns: int
    newest: int
    completed: int
    failures: int
    judges_failures: bool
    instance_hours: float
    total_usd: float
    seeds: int = 0
    usd_squares: float = 0.0
    failure_squares: float = 0.0
    usd_failures: float = 0.0
    errored: int = 0
    unresolved: int = 0


class MethodCost(msgspec.Struct, frozen=True, kw_only=True):
    """The cost of a failure with one method, over all its campaigns among some peers.

    Attributes:
        campaigns: how many were pooled.
        newest: the id of the newest one.
        failure_rate: over the episodes of all of them; None before the first one.
        cost: total cost ÷ failures. Its interval is that of the failure rate where episodes are
            drawn from p(x); of a search it is across seeds, and there is none unless `seeds`.
        seeds: number of seeds across which the interval holds; 0 if it does not rest on seeds.
    """

    method: str
    campaigns: int
    newest: int
    completed: int
    failures: int
    failure_rate: Rate | None
    cost: Cost
    seeds: int = 0


class PeerCosts(msgspec.Struct, frozen=True, kw_only=True):
    """Cost per failure by method among comparable campaigns.

    Attributes:
        methods: Monte Carlo first, then the cheapest first.
        notes: which campaigns are pooled, and what the numbers do not cover.
    """

    peers: Peers
    methods: tuple[MethodCost, ...]
    notes: tuple[str, ...]
