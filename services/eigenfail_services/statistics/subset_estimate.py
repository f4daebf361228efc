"""What a subset simulation is told, and what it found."""

from enum import StrEnum
from typing import Annotated

import msgspec
from msgspec import Meta

from eigenfail.values import Interval


class SubsetSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of a subset simulation."""

    samples: Annotated[int, Meta(ge=20, le=1_000_000, description="samples on each level")] = 2000
    share: Annotated[
        float, Meta(ge=0.05, le=0.5, description="share of them that is to reach the next level")
    ] = 0.1
    acceptance: Annotated[
        float, Meta(ge=0.1, le=0.9, description="share of the moves that is to be accepted")
    ] = 0.4
    most_levels: Annotated[int, Meta(ge=1, le=100, description="levels at most")] = 20


class End(StrEnum):
    """Why a subset simulation ended."""

    REACHED = "failures were reached"
    STALLED = "robustness falls no further"
    SPENT = "all levels were spent"


class Level(msgspec.Struct, frozen=True):
    """One level.

    Attributes:
        threshold: robustness at or below which a sample is on it.
        share: probability of that, given the level before.
        variation: coefficient of variation of `share`.
        acceptance: share of the moves that were accepted on the level before; 1 on the first.
    """

    threshold: float
    share: float
    variation: float
    acceptance: float


class SubsetEstimate(msgspec.Struct, frozen=True, kw_only=True):
    """What a subset simulation found.

    Attributes:
        probability: of a failure; None if none was reached: failures are rarer then than the
            product of the levels' shares.
        variation: coefficient of variation of that product.
        interval: 95 %, log-normal around `probability`; None without it. It knows nothing of a kind
            of failure of which no sample showed the beginning.
        ancestors: how many of the first, independent samples the failures descend from.
        evaluations: how often robustness was evaluated.
    """

    probability: float | None
    variation: float
    interval: Interval | None
    ancestors: int
    evaluations: int
    levels: tuple[Level, ...]
    end: End
