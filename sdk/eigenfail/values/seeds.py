"""Figures over seeds: campaigns that differ in their seeds alone are a random sample."""

import msgspec

from eigenfail.values.estimates import Cost, Interval, Rate
from eigenfail.values.showing import Brief, Shown


class SeedFigure(msgspec.Struct, frozen=True, kw_only=True):
    """A figure that each seed has one value of.

    Attributes:
        n: number of seeds with a value.
        deviation: standard deviation between seeds (n − 1); None with one value.
        least: smallest value.
        most: largest value.
        interval: Student's 95 % interval of the mean, with n − 1 degrees of freedom, cut if no
            mean can be; None with one value, and where all values are equal: they show no spread.
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
        """Whether several seeds all have the same value."""
        return self.n > 1 and self.least == self.most


class SeedValue(msgspec.Struct, frozen=True):
    """The value of one seed, and the id of its campaign."""

    seed: int
    campaign: int
    value: float


class FirstFailures(msgspec.Struct, frozen=True, kw_only=True):
    """Number of episodes up to the first failure of each seed, that one included.

    Attributes:
        median: over all seeds, those without a failure behind all others; None if it is one of
            these.
        worst: the largest; None if a seed has no failure.
        worst_seed: the seed of the largest one, or of the longest campaign without a failure.
        without: number of seeds without a failure.
        within: number of episodes that the worst seed completed.
    """

    median: float | None
    worst: int | None
    worst_seed: int
    without: int
    within: int


class SeedSpread(Brief, Shown, msgspec.Struct, frozen=True, kw_only=True):
    """Campaigns that differ in their seeds alone: mean and spread of their figures.

    Every seed counts alike, however many episodes it has.

    Attributes:
        name: the settings that distinguish this group from others that it was found with; its
            method if there are no others.
        campaigns: ids in the order of their seeds, of campaigns with a completed episode.
        seeds: seeds of these campaigns, each once.
        completed: episodes of all of them.
        failures: failures among these.
        share: share of the episodes that failed.
        worst: the seed with the lowest share; of equal ones that with the latest first failure.
        log_probability_per_step: log-probability per step of the failures, over seeds with one.
        mean_severity: mean severity of the failures, over seeds with one [m²/s²].
        first: number of episodes up to the first failure.
        cost: total price ÷ all failures, with its interval across seeds. If that is open above,
            there is only the lower bound; likewise if no seed has a failure.
        notes: limitations of these figures, as sentences.
        pooled: failure rate of all episodes together, if all of them were drawn from p(x): their
            mean over seeds has a wider interval, or none; None of a search.
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
