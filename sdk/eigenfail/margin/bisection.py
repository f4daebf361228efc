"""Bisection for the largest scale of the noise at which nothing fails: pure."""

from collections.abc import Callable, Iterable, Mapping
from typing import Annotated

import msgspec

from eigenfail.errors import InvalidValue

LARGEST_SCALE = 10.0
FINEST = 1e-3

Scale = Annotated[float, msgspec.Meta(gt=0.0, le=LARGEST_SCALE)]


class Range(msgspec.Struct, frozen=True):
    """Where to search.

    Attributes:
        low: smallest scale tried; both ends always are.
        high: largest scale tried.
        tolerance: the search ends when a scale with failures is this near to one without.
    """

    low: Scale
    high: Scale
    tolerance: Annotated[float, msgspec.Meta(ge=FINEST, le=LARGEST_SCALE)]

    def __post_init__(self) -> None:
        """Refuse an empty range."""
        if not self.low < self.high:
            raise InvalidValue("low", f"{self.low:g} is not below the high end, {self.high:g}.")

    def holds(self, scale: float) -> bool:
        """Whether it is between the ends, or one of them."""
        return self.low <= scale <= self.high


class Step(msgspec.Struct, frozen=True, kw_only=True):
    """What was found at one scale.

    Attributes:
        scale: of the disturbance model, in place of its own.
        campaign: the id of the campaign that tried.
        episodes: how many it completed.
        failures: how many of them ended in a collision.
        upper_bound: of the rate of failures among such episodes, where there was none (95 %; near
            3 ÷ episodes: the rule of three); None where there was one, since the first one ended
            the step.
    """

    scale: float
    campaign: int
    episodes: int
    failures: int
    upper_bound: float | None = None

    @property
    def is_safe(self) -> bool:
        """Whether no failure was found: no proof that there is none."""
        return self.failures == 0


class Margin(msgspec.Struct, frozen=True, kw_only=True):
    """Between which scales a planner begins to fail.

    Attributes:
        largest_safe: the largest scale without a failure below all scales with one; None if the
            smallest scale tried has failures.
        smallest_failing: the smallest scale with a failure; None if none has.
        contrary: scales without a failure above `smallest_failing`: the search is not monotone.
        steps: all that was tried, by scale.
    """

    largest_safe: Step | None
    smallest_failing: Step | None
    contrary: tuple[float, ...]
    steps: tuple[Step, ...]


def find_margin(
    measure: Callable[[float], Step], within: Range, known: Iterable[Step] = ()
) -> Margin:
    """Try both ends, then halve the gap between safe and failing until it is within tolerance.

    Args:
        measure: tries a scale.
        within: where to search, and how finely.
        known: what was tried before; those outside the range are left out.
    """
    steps = {step.scale: step for step in known if within.holds(step.scale)}
    while (scale := next_scale(steps, within)) is not None:
        steps[scale] = measure(scale)
    return margin_of(steps.values())


def next_scale(steps: Mapping[float, Step], within: Range) -> float | None:
    """The scale to try next; None when there is nothing left to learn."""
    for end in (within.low, within.high):
        if end not in steps:
            return end
    seen = margin_of(steps.values())
    if seen.largest_safe is None or seen.smallest_failing is None:
        return None
    safe, failing = seen.largest_safe.scale, seen.smallest_failing.scale
    return None if failing - safe <= within.tolerance else (safe + failing) / 2.0


def margin_of(steps: Iterable[Step]) -> Margin:
    """What the steps say together; where they contradict each other, the cautious reading."""
    ordered = tuple(sorted(steps, key=lambda step: step.scale))
    failing = next((step for step in ordered if not step.is_safe), None)
    before = ordered.index(failing) if failing else len(ordered)
    return Margin(
        largest_safe=ordered[before - 1] if before else None,
        smallest_failing=failing,
        contrary=tuple(step.scale for step in ordered[before:] if step.is_safe),
        steps=ordered,
    )
