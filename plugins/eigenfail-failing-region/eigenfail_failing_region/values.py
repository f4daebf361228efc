"""The failing region as a value: boxes of scenario parameters, with their shares of failures."""

import msgspec

from eigenfail.values.estimates import Rate


class Bound(msgspec.Struct, frozen=True, kw_only=True):
    """A side of a box, or two that face each other.

    Attributes:
        parameter: its name in the scenario.
        low: smallest value inside; None if the box is open.
        high: largest value inside; None if the box is open.
        unit: taken from the end of the name; empty if the name has none.
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
        precision: failures inside ÷ episodes inside: the failure rate there; None if none of
            the half that the figures are of is inside.
    """

    bounds: tuple[Bound, ...]
    words: str
    coverage: Rate
    precision: Rate | None


class Region(msgspec.Struct, frozen=True, kw_only=True):
    """The failing region: boxes whose episodes fail more often than elsewhere.

    They were found on one half of the episodes; every figure comes from the second half.

    Attributes:
        parameters: parameters that took more than one value.
        episodes: looked at, both halves.
        failures: among them.
        failure_rate: failure rate of the half that the figures are of; None if nothing was
            tried.
        boxes: the one with most of the failures first; empty if nothing can be concluded.
        coverage: coverage of all boxes together.
        precision: precision of all boxes together.
        p_value: probability of this many failures in the boxes by chance (Fisher's exact test,
            one-sided); None if there are none to test.
        problem: why the region is missing, and what to do; empty otherwise.
        warnings: limitations of the result.
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
