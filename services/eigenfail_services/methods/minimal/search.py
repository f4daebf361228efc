"""The search for a minimal failure, one phase after the other: pure values, no episodes.

Delta debugging (Zeller and Hildebrandt 2002, IEEE Trans. Softw. Eng. 28, 183-200) over blocks of
steps and axes: keep one block alone, leave one out, halve the blocks. Since many replays can run at
once, all candidates of a phase are tried together, and blocks that can go one by one are then left
out several at a time. What is left is made weaker by bisection, and looked through once more.
"""

from collections.abc import Callable, Sequence
from enum import StrEnum
from typing import NamedTuple

import msgspec
import numpy as np

from eigenfail.values import Floats
from eigenfail_services.methods.minimal.blocks import blocks, energy, only, unions, without

MOST_ALONE = 16
"""More blocks than this are not tried alone: a failure is hardly ever in so small a one."""

PARTS = 8
RESOLUTION = 1.0 / 64.0
"""The scale of what is left is known to this share of what it was."""

SAFE = 0
NOT_RUN = -1


class Phase(StrEnum):
    """What is tried next."""

    FULL = "full"
    ALONE = "alone"
    LEFT_OUT = "left_out"
    TOGETHER = "together"
    SCALES = "scales"
    OVER = "over"


class Search(msgspec.Struct, frozen=True, eq=False):
    """Where the search stands.

    Attributes:
        phase: what is tried next.
        z: noise that is known to fail, shape (steps, 2). [sigma]
        width: steps of a block.
        removable: in `TOGETHER`, the numbers of the blocks that can go one by one.
        low: in `SCALES`, the largest scale of z known to be safe; `high`, the smallest to fail.
        scaled: whether z is as weak as it may be.
        not_run: of the latest look through single steps, how many replays could not be run.
        tried: replays before this phase.
        best: the replay that showed z to fail, in `SCALES` at `high`, counted from 0; None before
            the failure was replayed.
    """

    phase: Phase
    z: Floats
    width: int
    removable: tuple[int, ...] = ()
    low: float = 0.0
    high: float = 1.0
    scaled: bool = False
    not_run: int = 0
    tried: int = 0
    best: int | None = None


class Failing(NamedTuple):
    """Noise that failed, without what came after its end, and the number of its replay."""

    z: Floats
    replay: int


def start(z: Floats) -> Search:
    """Before anything was replayed of a failure's noise, shape (steps, 2)."""
    return Search(Phase.FULL, z, len(z))


def candidates(search: Search) -> list[Floats]:
    """The noise to be tried in this phase, each shape (steps, 2); none once the search is over."""
    return CANDIDATES[search.phase](search)


def after(search: Search, ends: Sequence[int]) -> Search:
    """The search after a whole phase.

    Args:
        search: before it.
        ends: of each candidate the step after which it failed, or `SAFE`, or `NOT_RUN`. The failure
            itself, at full strength, has failed.
    """
    found = NEXT[search.phase](search, ends)
    return msgspec.structs.replace(found, tried=search.tried + len(ends))


def scales(search: Search) -> list[float]:
    """Seven scales between the safe and the failing one, evenly."""
    step = (search.high - search.low) / PARTS
    return [search.low + step * part for part in range(1, PARTS)]


def ended(z: Floats, end: int) -> Floats:
    """Noise, shape (steps, 2), without what came after its end."""
    kept = z.copy()
    kept[end:] = 0.0
    return kept


def least(search: Search, ends: Sequence[int]) -> Failing | None:
    """Of the candidates that failed, the one with the least noise up to its end."""
    tried = enumerate(zip(candidates(search), ends, strict=True), search.tried)
    failed = [Failing(ended(z, end), number) for number, (z, end) in tried if end > SAFE]
    return min(failed, key=lambda each: energy(each.z), default=None)


def at_width(search: Search, width: int) -> Search:
    """Begin with blocks of another width."""
    few = 2 < len(blocks(search.z, width)) <= MOST_ALONE
    phase = Phase.ALONE if few else Phase.LEFT_OUT
    return msgspec.structs.replace(search, phase=phase, width=width)


def with_less(search: Search, found: Failing) -> Search:
    """Go on from less noise, with blocks of the same width."""
    phase = Phase.LEFT_OUT if found.z.any() else Phase.OVER
    return msgspec.structs.replace(
        search, phase=phase, z=found.z, best=found.replay, removable=(), scaled=False
    )


def after_full(search: Search, ends: Sequence[int]) -> Search:
    """It fails: what comes after its end does not matter."""
    found = least(search, ends)
    return search if found is None else with_less(search, found)


def after_alone(search: Search, ends: Sequence[int]) -> Search:
    """A block that fails alone is all that is needed."""
    found = least(search, ends)
    left_out = msgspec.structs.replace(search, phase=Phase.LEFT_OUT)
    return left_out if found is None else with_less(search, found)


def after_left_out(search: Search, ends: Sequence[int]) -> Search:
    """Blocks that can go are left out; where none can, the blocks are too large, or all is done."""
    removable = tuple(number for number, end in enumerate(ends) if end > SAFE)
    found = least(search, ends)
    if found is None:
        return finer(msgspec.structs.replace(search, not_run=list(ends).count(NOT_RUN)))
    if len(removable) == 1:
        return with_less(search, found)
    return msgspec.structs.replace(search, phase=Phase.TOGETHER, removable=removable)


def finer(search: Search) -> Search:
    """Smaller blocks; after single steps the scale; after that nothing."""
    if search.width > 1:
        return at_width(search, -(-search.width // 2))
    if search.scaled:
        return msgspec.structs.replace(search, phase=Phase.OVER)
    return msgspec.structs.replace(search, phase=Phase.SCALES, low=0.0, high=1.0)


def after_together(search: Search, ends: Sequence[int]) -> Search:
    """As many as can go together; of those that cannot, the strongest alone."""
    found = least(search, ends)
    if found is None:
        every = blocks(search.z, search.width)
        # The phase before this one left out each of them alone.
        first = search.tried - len(every)
        alone = [Failing(without(search.z, every[n]), first + n) for n in search.removable]
        found = min(alone, key=lambda each: energy(each.z))
    return with_less(search, found)


def after_scales(search: Search, ends: Sequence[int]) -> Search:
    """Between the smallest scale that failed and the next below it, until they are near."""
    tried = [search.low, *scales(search), search.high]
    first = next((place for place, end in enumerate(ends, 1) if end > SAFE), PARTS)
    best = search.tried + first - 1 if first < PARTS else search.best
    low, high = tried[first - 1], tried[first]
    narrowed = msgspec.structs.replace(search, low=low, high=high, best=best)
    if narrowed.high - narrowed.low > RESOLUTION:
        return narrowed
    if narrowed.high == 1.0:
        return msgspec.structs.replace(narrowed, phase=Phase.OVER, scaled=True)
    weaker = narrowed.z * np.float32(narrowed.high)
    return msgspec.structs.replace(narrowed, phase=Phase.LEFT_OUT, z=weaker, scaled=True)


CANDIDATES: dict[Phase, Callable[[Search], list[Floats]]] = {
    Phase.FULL: lambda search: [search.z],
    Phase.ALONE: lambda search: [only(search.z, b) for b in blocks(search.z, search.width)],
    Phase.LEFT_OUT: lambda search: [without(search.z, b) for b in blocks(search.z, search.width)],
    Phase.TOGETHER: lambda search: [
        without(search.z, union)
        for every in (blocks(search.z, search.width),)
        for union in unions(search.z, [every[number] for number in search.removable])
    ],
    Phase.SCALES: lambda search: [search.z * np.float32(scale) for scale in scales(search)],
    Phase.OVER: lambda _search: [],
}
NEXT: dict[Phase, Callable[[Search, Sequence[int]], Search]] = {
    Phase.FULL: after_full,
    Phase.ALONE: after_alone,
    Phase.LEFT_OUT: after_left_out,
    Phase.TOGETHER: after_together,
    Phase.SCALES: after_scales,
    Phase.OVER: lambda search, _ends: search,
}
