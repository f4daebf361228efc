"""Search for a minimal failure in phases, as pure values without episodes.

Delta debugging (Zeller and Hildebrandt 2002, IEEE Trans. Softw. Eng. 28, 183-200) over blocks of
steps and channels: keep one block alone, remove one block, halve the blocks. Many replays can run
at the same time, so all candidates of a phase are tried together. Blocks that can be removed one by
one are then removed in unions. The rest is weakened by bisection and searched once more.

Noise is z of shape (steps, channels), and a block is a mask of that shape.
"""

from collections.abc import Callable, Iterator, Sequence
from enum import StrEnum
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.values.arrays import Floats

Mask = NDArray[np.bool_]


UNION_SIZES = 8
"""Number of sizes of unions."""


def make_blocks(z: Floats, width: int) -> list[Mask]:
    """Return the blocks with noise: `width` steps of one channel, counted back from the last step.

    Returns:
        Blocks by channel, from the last block to the first.
    """
    steps, channels = z.shape
    found = []
    for channel in range(channels):
        for end in range(steps, 0, -width):
            mask = np.zeros(z.shape, bool)
            mask[max(end - width, 0) : end, channel] = True
            found.append(mask)
    return [mask for mask in found if z[mask].any()]


def remove_block(z: Floats, mask: Mask) -> Floats:
    """Return the noise without a block."""
    return np.where(mask, np.float32(0.0), z)


def keep_block(z: Floats, mask: Mask) -> Floats:
    """Return the noise of a block alone."""
    return remove_block(z, ~mask)


def compute_energy(z: Floats) -> float:
    """Return the sum of squares: for white normal noise, -2 log p(z) up to a constant. [sigma²]"""
    return float(np.sum(np.square(z, dtype=np.float64)))


def list_unions(z: Floats, removable: Sequence[Mask]) -> Iterator[Mask]:
    """Yield unions of the weakest and of the earliest removable blocks, in eight sizes."""
    by_energy = sorted(removable, key=lambda mask: compute_energy(keep_block(z, mask)))
    by_time = sorted(removable, key=lambda mask: int(np.argmax(mask.any(axis=1))))
    seen = set()
    for order in (by_energy, by_time):
        for size in _list_sizes(len(order)):
            union: Mask = np.logical_or.reduce(order[:size])
            if union.tobytes() not in seen:
                seen.add(union.tobytes())
                yield union


def _list_sizes(count: int) -> list[int]:
    """Return sizes from all blocks down to an eighth of them, at least two."""
    graded = {-(-count * share // UNION_SIZES) for share in range(1, UNION_SIZES + 1)}
    return sorted((size for size in graded if size > 1), reverse=True)


MAX_ALONE = 16
"""Most blocks that are tried alone: smaller ones are hardly ever sufficient for a failure."""


PARTS = 8


RESOLUTION = 1.0 / 64.0
"""Resolution of the scale of the noise, as a share of the initial scale."""


SAFE = 0


NOT_RUN = -1


class SearchPhase(StrEnum):
    """Phase of the search, named after its candidates."""

    FULL = "full"
    ALONE = "alone"
    LEFT_OUT = "left_out"
    TOGETHER = "together"
    SCALES = "scales"
    OVER = "over"


class Search(msgspec.Struct, frozen=True, eq=False):
    """State of the search.

    Attributes:
        phase: the kind of reduction that is tried next.
        z: noise that is known to fail, shape (steps, channels). [sigma]
        width: number of steps of a block.
        removable: in the phase `TOGETHER`, the numbers of the blocks that can be removed one by
            one.
        low: in the phase `SCALES`, the largest scale of z known to be safe.
        high: in the phase `SCALES`, the smallest scale of z known to fail.
        scaled: whether z is as weak as possible.
        not_run: number of errored replays, in the last phase with single steps.
        tried: number of replays before this phase.
        best: number of the replay that failed with z, in the phase `SCALES` with z at scale `high`,
            counted from 0; None before the failure was replayed.
    """

    phase: SearchPhase
    z: Floats
    width: int
    removable: tuple[int, ...] = ()
    low: float = 0.0
    high: float = 1.0
    scaled: bool = False
    not_run: int = 0
    tried: int = 0
    best: int | None = None


class FailingNoise(NamedTuple):
    """Failing noise up to the end of its episode, and the number of its replay."""

    z: Floats
    replay: int


def start_search(z: Floats) -> Search:
    """Return the initial search for a failure's noise of shape (steps, channels)."""
    return Search(SearchPhase.FULL, z, len(z))


def list_candidates(search: Search) -> list[Floats]:
    """Return the noise to try in this phase, each (steps, channels); none after the end."""
    return CANDIDATES[search.phase](search)


def advance(search: Search, ends: Sequence[int]) -> Search:
    """Return the search after a complete phase.

    Args:
        search: search before the phase.
        ends: step after which each candidate failed, or `SAFE`, or `NOT_RUN`; the failure itself,
            at full strength, must have failed.
    """
    found = NEXT[search.phase](search, ends)
    return msgspec.structs.replace(found, tried=search.tried + len(ends))


def _list_scales(search: Search) -> list[float]:
    """Return seven equidistant scales between the safe and the failing scale."""
    step = (search.high - search.low) / PARTS
    return [search.low + step * part for part in range(1, PARTS)]


def _remove_unions(search: Search) -> list[Floats]:
    """Return the noise without each union of the blocks that can be removed one by one."""
    every = make_blocks(search.z, search.width)
    removable = [every[number] for number in search.removable]
    return [remove_block(search.z, union) for union in list_unions(search.z, removable)]


def _cut_after(z: Floats, end: int) -> Floats:
    """Return noise of shape (steps, channels) with zeros after its end."""
    kept = z.copy()
    kept[end:] = 0.0
    return kept


def _find_least(search: Search, ends: Sequence[int]) -> FailingNoise | None:
    """Return the candidate that failed with the least noise up to its end."""
    tried = enumerate(zip(list_candidates(search), ends, strict=True), search.tried)
    # Noise behind the collision did nothing: it is taken off before candidates are compared.
    failed = [FailingNoise(_cut_after(z, end), number) for number, (z, end) in tried if end > SAFE]
    return min(failed, key=lambda each: compute_energy(each.z), default=None)


def _start_width(search: Search, width: int) -> Search:
    """Return the search with blocks of another width."""
    # With two blocks, keeping one alone is the same as removing the other.
    few = 2 < len(make_blocks(search.z, width)) <= MAX_ALONE
    phase = SearchPhase.ALONE if few else SearchPhase.LEFT_OUT
    return msgspec.structs.replace(search, phase=phase, width=width)


def _continue_with(search: Search, found: FailingNoise) -> Search:
    """Return the search with less noise, and blocks of the same width."""
    phase = SearchPhase.LEFT_OUT if found.z.any() else SearchPhase.OVER
    return msgspec.structs.replace(
        search, phase=phase, z=found.z, best=found.replay, removable=(), scaled=False
    )


def _advance_full(search: Search, ends: Sequence[int]) -> Search:
    """Remove the noise after the end of the failure."""
    found = _find_least(search, ends)
    return search if found is None else _continue_with(search, found)


def _advance_alone(search: Search, ends: Sequence[int]) -> Search:
    """Keep a block that fails alone."""
    found = _find_least(search, ends)
    left_out = msgspec.structs.replace(search, phase=SearchPhase.LEFT_OUT)
    return left_out if found is None else _continue_with(search, found)


def _advance_left_out(search: Search, ends: Sequence[int]) -> Search:
    """Remove blocks; if none can be removed, try smaller ones."""
    removable = tuple(number for number, end in enumerate(ends) if end > SAFE)
    found = _find_least(search, ends)
    if found is None:
        return _start_finer(msgspec.structs.replace(search, not_run=list(ends).count(NOT_RUN)))
    if len(removable) == 1:
        return _continue_with(search, found)
    return msgspec.structs.replace(search, phase=SearchPhase.TOGETHER, removable=removable)


def _start_finer(search: Search) -> Search:
    """Start smaller blocks; after single steps start scales; after scales end the search."""
    if search.width > 1:
        return _start_width(search, -(-search.width // 2))
    if search.scaled:
        return msgspec.structs.replace(search, phase=SearchPhase.OVER)
    return msgspec.structs.replace(search, phase=SearchPhase.SCALES, low=0.0, high=1.0)


def _advance_together(search: Search, ends: Sequence[int]) -> Search:
    """Remove the largest union that still fails; without one, the strongest single block."""
    found = _find_least(search, ends)
    if found is None:
        every = make_blocks(search.z, search.width)
        # The phase before this one has removed each of them alone.
        first = search.tried - len(every)
        alone = [
            FailingNoise(remove_block(search.z, every[n]), first + n) for n in search.removable
        ]
        found = min(alone, key=lambda each: compute_energy(each.z))
    return _continue_with(search, found)


def _advance_scales(search: Search, ends: Sequence[int]) -> Search:
    """Narrow the interval between the largest safe and the smallest failing scale."""
    tried = [search.low, *_list_scales(search), search.high]
    first = next((place for place, end in enumerate(ends, 1) if end > SAFE), PARTS)
    best = search.tried + first - 1 if first < PARTS else search.best
    low, high = tried[first - 1], tried[first]
    narrowed = msgspec.structs.replace(search, low=low, high=high, best=best)
    if narrowed.high - narrowed.low > RESOLUTION:
        return narrowed
    # No weaker noise failed: nothing has changed that could make blocks removable.
    if narrowed.high == 1.0:
        return msgspec.structs.replace(narrowed, phase=SearchPhase.OVER, scaled=True)
    # Weaker noise may do without further blocks: their removal is tried once more.
    weaker = narrowed.z * np.float32(narrowed.high)
    return msgspec.structs.replace(narrowed, phase=SearchPhase.LEFT_OUT, z=weaker, scaled=True)


CANDIDATES: dict[SearchPhase, Callable[[Search], list[Floats]]] = {
    SearchPhase.FULL: lambda search: [search.z],
    SearchPhase.ALONE: lambda search: [
        keep_block(search.z, b) for b in make_blocks(search.z, search.width)
    ],
    SearchPhase.LEFT_OUT: lambda search: [
        remove_block(search.z, b) for b in make_blocks(search.z, search.width)
    ],
    SearchPhase.TOGETHER: _remove_unions,
    SearchPhase.SCALES: lambda search: [
        search.z * np.float32(scale) for scale in _list_scales(search)
    ],
    SearchPhase.OVER: lambda _search: [],
}


NEXT: dict[SearchPhase, Callable[[Search, Sequence[int]], Search]] = {
    SearchPhase.FULL: _advance_full,
    SearchPhase.ALONE: _advance_alone,
    SearchPhase.LEFT_OUT: _advance_left_out,
    SearchPhase.TOGETHER: _advance_together,
    SearchPhase.SCALES: _advance_scales,
    SearchPhase.OVER: lambda search, _ends: search,
}
