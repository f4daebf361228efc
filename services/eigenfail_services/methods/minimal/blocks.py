"""Noise in blocks: some steps of one axis, to be left out or kept together.

Noise is z of shape (steps, 2), and a block a mask of that shape.
"""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from eigenfail.values import Floats

Mask = NDArray[np.bool_]

SHARES = 8
"""Into so many sizes unions of blocks are graded."""


def blocks(z: Floats, width: int) -> list[Mask]:
    """The blocks that hold noise: `width` steps of one axis each, counted back from the last step.

    Returns:
        By axis and then from the last to the first.
    """
    steps, axes = z.shape
    found = []
    for axis in range(axes):
        for end in range(steps, 0, -width):
            mask = np.zeros(z.shape, bool)
            mask[max(end - width, 0) : end, axis] = True
            found.append(mask)
    return [mask for mask in found if z[mask].any()]


def without(z: Floats, mask: Mask) -> Floats:
    """The noise with a block left out."""
    return np.where(mask, np.float32(0.0), z)


def only(z: Floats, mask: Mask) -> Floats:
    """The noise with nothing but a block."""
    return without(z, ~mask)


def energy(z: Floats) -> float:
    """Sum of squares: of white normal noise -2 log p(z), but for a constant. [sigma²]"""
    return float(np.sum(np.square(z, dtype=np.float64)))


def unions(z: Floats, removable: Sequence[Mask]) -> Iterator[Mask]:
    """Blocks to be left out together: the weakest first, or the earliest first, in eight sizes."""
    by_energy = sorted(removable, key=lambda mask: energy(only(z, mask)))
    by_time = sorted(removable, key=lambda mask: int(np.argmax(mask.any(axis=1))))
    seen = set()
    for order in (by_energy, by_time):
        for size in sizes(len(order)):
            union = together(order[:size])
            if union.tobytes() not in seen:
                seen.add(union.tobytes())
                yield union


def sizes(count: int) -> list[int]:
    """From all down to an eighth of them, at least two."""
    graded = {-(-count * share // SHARES) for share in range(1, SHARES + 1)}
    return sorted((size for size in graded if size > 1), reverse=True)


def together(masks: Iterable[Mask]) -> Mask:
    """All of them in one."""
    union: Mask = np.logical_or.reduce(list(masks))
    return union
