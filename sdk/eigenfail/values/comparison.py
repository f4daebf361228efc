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
        """Number of pairs."""
        return self.both + self.only_first + self.only_second + self.neither


class Side(msgspec.Struct, frozen=True, kw_only=True):
    """The findings of the campaigns of one side, taken together.

    Attributes:
        campaigns: ids of the campaigns, one for each seed.
        completed: number of completed episodes.
        failures: number of failures among them.
        failure_rate: failure rate with its interval; None before the first episode.
        rates: the failure rate of each campaign; None before its first episode.
        log_probability_per_step: log-probability per step of the failures: sum of log p over all
            their steps ÷ steps.
        mean_severity: mean severity of the collisions [m²/s²].
        cost: cost of all campaigns together, per failure of any campaign.
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
    """Difference of the failure rates, B minus A, as a fraction of 1.

    Attributes:
        interval: Tango's score interval of paired samples, or Newcombe's hybrid score interval of
            independent ones. For searches, it treats the episodes as a random sample, which they
            are not: use it only as a rule of the gate, and do not quote it.
        n_a: number of completed episodes of A behind its rate.
        n_b: number of completed episodes of B behind its rate.
        is_paired: whether the rates are of pairs of episodes with the same noise.
    """

    value: float
    interval: Interval
    n_a: Count
    n_b: Count
    is_paired: bool = False


class McNemar(msgspec.Struct, frozen=True):
    """McNemar's exact test on paired episodes, based on pairs with a single failure.

    Attributes:
        n: number of pairs.
        both: pairs with a failure on both sides.
        only_a: pairs with a failure on side A only.
        only_b: pairs with a failure on side B only.
        neither: pairs without a failure.
        p_value: two-sided p-value.
    """

    n: int
    both: int
    only_a: int
    only_b: int
    neither: int
    p_value: float


class Magnitude(StrEnum):
    """Magnitude of an effect (Vargha and Delaney 2000)."""

    NEGLIGIBLE = "negligible"
    SMALL = "small"
    MEDIUM = "medium"
    LARGE = "large"


class EffectSize(msgspec.Struct, frozen=True):
    """Vargha and Delaney's A12 over campaigns, by failure rate.

    Attributes:
        a12: probability that a campaign of B has a higher failure rate than a campaign of A; ties
            count half.
        n_a: number of campaigns of A.
        n_b: number of campaigns of B.
    """

    a12: float
    magnitude: Magnitude
    n_a: int
    n_b: int


class Distinction(msgspec.Struct, frozen=True):
    """A setting that differs between the two sides, in words."""

    thing: str
    a: str
    b: str


class Comparison(Brief, Shown, msgspec.Struct, frozen=True, kw_only=True):
    """Two groups of campaigns, side by side.

    Attributes:
        difference: difference of the failure rates; None until both sides have completed an
            episode.
        pairs: test on pairs; None if episodes are not paired.
        unpaired_because: why episodes are not paired; empty if they are.
        effect: effect size; None with so few campaigns that even full separation could be chance.
        distinctions: settings that differ between the sides.
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
        """True if both sides have rates of random samples, so that they can be compared."""
        rates = (self.a.failure_rate, self.b.failure_rate)
        return all(rate is not None and rate.sampled for rate in rates)


class Peers(msgspec.Struct, frozen=True, kw_only=True):
    """The fields that campaigns with comparable costs have in common.

    Attributes:
        planner_settings: settings that differ from the planner's defaults.
        scenario_parameters: parameters that differ from the scenario's defaults, each a value or a
            distribution.
        requirements: conditions that an episode must satisfy; None: no collision.
    """

    planner: str
    planner_settings: Settings
    scenario: str
    scenario_parameters: Settings
    simulator: str
    disturbance: DisturbanceModel
    requirements: Requirements | None = None


class Pool(msgspec.Struct, frozen=True, kw_only=True):
    """Sums over the campaigns of one method among peers.

    Attributes:
        campaigns: number of campaigns.
        newest: id of the newest campaign.
        completed: number of completed episodes.
        failures: number of failures among them.
        errored: number of episodes that errored.
        unresolved: number of episodes that are unresolved.
        judges_failures: whether a stop rule of one of the campaigns judges failures.
        instance_hours: instance-hours of all campaigns. [h]
        total_usd: total cost of all campaigns. [USD]
        seeds: number of campaigns with a completed episode. 0 unless these differ only in name,
            priority and seed, and all seeds differ. 0 also if a campaign without a completed
            episode has costs.
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
        campaigns: number of pooled campaigns.
        newest: id of the newest campaign.
        failure_rate: failure rate over all their episodes; None before the first episode.
        cost: total cost ÷ failures. If episodes are drawn from p(x), the interval follows from the
            interval of the failure rate. For a search, it is an interval across seeds, which exists
            only if `seeds` is above 0.
        seeds: number of seeds behind the interval; 0 if the interval does not rest on seeds.
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
        methods: cost by method: Monte Carlo first, then the cheapest first.
        notes: which campaigns are pooled, and the limits of the numbers.
    """

    peers: Peers
    methods: tuple[MethodCost, ...]
    notes: tuple[str, ...]
