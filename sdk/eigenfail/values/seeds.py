"""Figures over seeds: campaigns that differ only in their seeds are a random sample."""

import msgspec

from eigenfail.values.estimates import Cost, Interval, Rate
from eigenfail.values.showing import Brief, Shown


class SeedFigure(msgspec.Struct, frozen=True, kw_only=True):
    """A figure with one value for each seed.

    Attributes:
        n: number of seeds with a value.
        deviation: standard deviation between seeds (n − 1); None with one value.
        least: smallest value.
        most: largest value.
        interval: Student's 95 % interval of the mean, with n − 1 degrees of freedom, cut to the
            possible means. None with one value, or if all values are equal and show no spread.
    """

    n: int
    mean: float
    deviation: float | None
    least: float
    median: float
    most: float
    interval: Interval | None

    @property
    def is_constant(self) -> bool:
        """True if there are several seeds, and all have the same value."""
        return self.n > 1 and self.least == self.most


class SeedValue(msgspec.Struct, frozen=True):
    """The value of one seed, and the id of its campaign."""

    seed: int
    campaign: int
    value: float


class FirstFailures(msgspec.Struct, frozen=True, kw_only=True):
    """Number of episodes up to and including the first failure of each seed.

    Attributes:
        median: median over all seeds; seeds without a failure rank last. None if it depends
            on such a seed.
        worst: the largest number; None if a seed is without a failure.
        worst_seed: the seed of the largest number, or of the longest campaign without a failure.
        without: number of seeds without a failure.
        within: number of episodes that the worst seed completed.
    """

    median: float | None
    worst: int | None
    worst_seed: int
    without: int
    within: int


class SeedSpread(Brief, Shown, msgspec.Struct, frozen=True, kw_only=True):
    """Campaigns that differ only in their seeds: mean and spread of their figures.

    Every seed has the same weight, regardless of its number of episodes.

    Attributes:
        name: settings that distinguish this group from groups found with it; its method if it is
            the only group.
        campaigns: ids of the campaigns with a completed episode, in the order of their seeds.
        seeds: their seeds, each once.
        completed: number of their completed episodes.
        failures: number of failures among them.
        share: share of the episodes that failed.
        worst: the seed with the lowest share; among equal ones, with the latest first failure.
        log_probability_per_step: log-probability per step of the failures, over seeds with one.
        mean_severity: mean severity of the collisions, over seeds with one [m²/s²].
        first: number of episodes up to the first failure.
        cost: total price ÷ all failures, with its interval across seeds. If the interval is open
            above, or all seeds are without a failure, there is only the lower bound.
        notes: limitations of the figures, as sentences.
        pooled: failure rate of all episodes together, if they were all drawn from p(x); None for a
            search. The interval of the mean over seeds is wider, or missing.
    """

    name: str
    method: str
    campaigns: tuple[int, ...]
    seeds: tuple[int, ...]
    completed: int
    failures: int
    share: SeedFigure
    worst: SeedValue
    log_probability_per_step: SeedFigure | None
    mean_severity: SeedFigure | None
    first: FirstFailures
    cost: Cost
    notes: tuple[str, ...] = ()
    pooled: Rate | None = None
