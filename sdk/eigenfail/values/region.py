"""Where among a scenario's parameters a planner fails."""

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.values.campaign import Rate

MOST_TRIALS = 20_000
"""How many episodes a region rests on at most."""


class Trials(msgspec.Struct, frozen=True, eq=False):
    """Completed episodes of a campaign, by seed and outcome: all, or every k-th in index order.

    Attributes:
        seeds: from which each drew its parameters, shape (n,).
        failed: which of them collided, shape (n,).
    """

    seeds: NDArray[np.int64]
    failed: NDArray[np.bool_]


class Bound(msgspec.Struct, frozen=True, kw_only=True):
    """A side of a box, or two that face each other.

    Attributes:
        parameter: its name in the scenario.
        low: smallest value inside; None where the box is open.
        high: largest value inside; None where the box is open.
        unit: as its name tells; empty where it does not.
        words: as people read it: "distance 52 to 55.9 m".
    """

    parameter: str
    low: float | None
    high: float | None
    unit: str
    words: str


class Box(msgspec.Struct, frozen=True, kw_only=True):
    """A part of the failing region.

    Attributes:
        words: its bounds in a line.
        coverage: failures inside ÷ all failures.
        precision: failures inside ÷ episodes inside: the failure rate there; None where none of
            the half that the figures are of is inside.
    """

    bounds: tuple[Bound, ...]
    words: str
    coverage: Rate
    precision: Rate | None


class Region(msgspec.Struct, frozen=True, kw_only=True):
    """The failing region: boxes in which episodes fail more often than elsewhere.

    They were found on one half of the episodes; every figure is of the other half.

    Attributes:
        parameters: those that took more than one value.
        episodes: looked at, both halves.
        failures: among them.
        failure_rate: of the half that the figures are of; None where nothing was tried.
        boxes: the one with most of the failures first; empty where nothing can be told.
        coverage: of all boxes together.
        precision: of all boxes together.
        p_value: how likely chance alone puts so many failures into the boxes (Fisher's exact test,
            one-sided); None where there are none to test.
        problem: why there is no region, and what to do; empty otherwise.
        warnings: what keeps it from saying more.
    """

    campaigns: tuple[int, ...]
    scenario: str
    parameters: tuple[str, ...]
    episodes: int
    failures: int
    failure_rate: Rate | None = None
    boxes: tuple[Box, ...] = ()
    coverage: Rate | None = None
    precision: Rate | None = None
    p_value: float | None = None
    problem: str = ""
    warnings: tuple[str, ...] = ()
