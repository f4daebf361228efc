"""The course of a campaign: how failures, likelihood and robustness moved over its episodes."""

import msgspec

from eigenfail.values.campaign import Rate
from eigenfail.values.showing import Brief, Shown, Tabular

MOST_BLOCKS = 1_000
"""How many blocks a course has at most."""


class BlockTotals(msgspec.Struct, frozen=True):
    """Sums over the completed episodes with an index from `first` to before the next block.

    Attributes:
        first: a multiple of the block's length.
        completed: at least one.
        failures: collisions among them.
        log_probability: sum of log p over all steps of the failures.
        steps: of the failures.
        smallest_robustness_m: None if nothing was measured.
        median_robustness_m: of two middle ones their mean; None if nothing was measured.
    """

    first: int
    completed: int
    failures: int
    log_probability: float
    steps: int
    smallest_robustness_m: float | None
    median_robustness_m: float | None


class CourseBlock(msgspec.Struct, frozen=True, kw_only=True):
    """Neighbouring episodes of a campaign, as far as they were completed.

    Attributes:
        first: smallest index.
        last: largest index.
        failure_rate: collisions ÷ completed episodes, with its interval.
        log_probability_per_step: of the failures: sum of log p over all their steps ÷ steps; None
            without one.
    """

    first: int
    last: int
    failure_rate: Rate
    log_probability_per_step: float | None
    smallest_robustness_m: float | None
    median_robustness_m: float | None


class Course(Brief, Shown, Tabular, msgspec.Struct, frozen=True, kw_only=True):
    """A campaign over its episodes.

    Attributes:
        heading: "Learning curve" of a method that learns, else "Failures over episodes".
        per: how many indices a block spans.
        blocks: in index order; those without a completed episode are left out.
    """

    campaign: int
    method: str
    heading: str
    per: int
    blocks: tuple[CourseBlock, ...]
