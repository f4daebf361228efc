"""Two groups of campaigns, A and B, side by side."""

from enum import StrEnum

import msgspec

from eigenfail.values.campaign import Cost, Interval, Rate
from eigenfail.values.showing import Brief, Shown, Tabular


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
    """What the campaigns of one side found, taken together.

    Attributes:
        campaigns: their ids, one for each seed.
        completed: episodes.
        failures: collisions among them.
        failure_rate: with Wilson's interval; None before the first episode.
        rates: the failure rate of each campaign; None before its first episode.
        log_probability_per_step: of the failures: sum of log p over all their steps ÷ steps.
        mean_severity: of the failures [m²/s²].
        cost: of all campaigns together, per failure of any.
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
        interval: Newcombe's hybrid score interval.
        n_a: completed episodes of A.
        n_b: of B.
    """

    value: float
    interval: Interval
    n_a: int
    n_b: int


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
        n_b: of B.
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


class Comparison(Brief, Shown, Tabular, msgspec.Struct, frozen=True, kw_only=True):
    """Two groups of campaigns, side by side.

    Attributes:
        difference: None before both have completed an episode.
        pairs: None where episodes are not paired.
        unpaired_because: why not, in words; empty where they are.
        effect: None with fewer than two campaigns on a side.
        distinctions: in what the sides differ.
        sentences: what all of it says.
        warnings: what keeps it from saying more.
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
