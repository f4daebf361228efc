"""What a margin means, in sentences."""

from collections.abc import Iterator

from eigenfail.margin.bisection import Margin, Step

BY_CHANCE = "monte_carlo"
"""The method whose rate of failures is that of the disturbance model."""


def conclusions(margin: Margin, method: str) -> list[str]:
    """What may be said, and what may not."""
    return [verdict(margin), *contradictions(margin), *caveats(margin, method)]


def verdict(margin: Margin) -> str:
    """How much noise the planner bears, in one sentence."""
    safe, failing = margin.largest_safe, margin.smallest_failing
    if safe is None and failing is not None:
        return (
            f"It fails already at {times(failing)} the noise, the low end of the search:"
            " there is no margin to tell. Search lower."
        )
    if safe is not None and failing is None:
        return (
            f"No failure was found up to {times(safe)} the noise, the high end of the search:"
            " the margin may be larger. Search higher, or with another method."
        )
    if safe is None or failing is None:
        return "Nothing was tried."
    return between(safe, failing)


def between(safe: Step, failing: Step) -> str:
    """The sentence that people want."""
    if safe.scale > 1.0:
        return (
            f"Your sensor requirement may be relaxed to {times(safe)} before this planner fails:"
            f" a failure was found at {times(failing)}."
        )
    if failing.scale <= 1.0:
        return (
            f"Your sensor requirement must be tightened to {times(safe)}:"
            f" this planner fails at {times(failing)}."
        )
    return (
        f"Your sensor requirement has no margin to relax: no failure was found at {times(safe)},"
        f" one was at {times(failing)}."
    )


def contradictions(margin: Margin) -> Iterator[str]:
    """That more noise was harmless where less was not."""
    if margin.contrary and margin.smallest_failing:
        above = ", ".join(f"{scale:.4g} ×" for scale in margin.contrary)
        yield (
            f"Not monotone: no failure was found at {above}, above the failure at"
            f" {times(margin.smallest_failing)}. The cautious reading counts;"
            " a larger budget may settle it."
        )


def caveats(margin: Margin, method: str) -> Iterator[str]:
    """What a search without a failure proves."""
    safe = margin.largest_safe
    if safe is None or safe.upper_bound is None:
        return
    kind = (
        "episodes under this noise"
        if method == BY_CHANCE
        else f"episodes as '{method}' proposes them, whose rate is not that of the noise itself"
    )
    yield (
        f"No failure found in {safe.episodes} episodes at {times(safe)} is not proof that there"
        f" is none: with 95 % confidence at most {100.0 * safe.upper_bound:.2g} % fail of {kind}."
    )


def times(step: Step) -> str:
    """A scale, as people write it."""
    return f"{step.scale:.4g} ×"
