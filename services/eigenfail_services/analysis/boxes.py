"""Leaves of a decision tree as boxes, in numbers and in words."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sklearn.tree import DecisionTreeClassifier

from eigenfail.values.region import Bound

Table = NDArray[np.float64]
Flags = NDArray[np.bool_]

UNITS = {
    "m": "m",
    "s": "s",
    "mps": "m/s",
    "mps2": "m/s²",
    "mps3": "m/s³",
    "rad": "rad",
    "deg": "°",
    "kg": "kg",
    "kw": "kW",
}
"""What the last part of a parameter's name says of its unit."""


class Leaf(NamedTuple):
    """A box: values above `low` and at most `high`, one of each for a parameter; ±inf is open."""

    low: Table
    high: Table

    def holds(self, values: Table) -> Flags:
        """Which rows are inside, shape (n,)."""
        within = (values > self.low) & (values <= self.high)
        inside: Flags = np.logical_and.reduce(within, axis=1)
        return inside

    def cut(self, parameter: int, at: float) -> tuple["Leaf", "Leaf"]:
        """The part at most there, and the part above."""
        high, low = self.high.copy(), self.low.copy()
        high[parameter] = min(high[parameter], at)
        low[parameter] = max(low[parameter], at)
        return Leaf(self.low, high), Leaf(low, self.high)


class Growth(NamedTuple):
    """A tree and the episodes that it was grown on.

    Attributes:
        tree: of scikit-learn.
        values: shape (rows, parameters).
        failed: shape (rows,).
    """

    tree: DecisionTreeClassifier
    values: Table
    failed: Flags

    def fails(self, leaf: Leaf) -> bool:
        """Whether episodes in a box fail more often than all of them."""
        inside = leaf.holds(self.values)
        return bool(inside.any() and self.failed[inside].mean() > self.failed.mean())


def failing_leaves(growth: Growth) -> list[Leaf]:
    """The boxes that fail more often than the whole; neighbours that both do are one."""
    width = growth.values.shape[1]
    whole = Leaf(np.full(width, -np.inf), np.full(width, np.inf))
    return descend(growth, 0, whole)


def descend(growth: Growth, node: int, span: Leaf) -> list[Leaf]:
    """The failing boxes below a node, or the node's own where all of it fails."""
    found = growth.tree.tree_
    if found.children_left[node] < 0:
        return [span] if growth.fails(span) else []
    near, far = span.cut(int(found.feature[node]), float(found.threshold[node]))
    below = [
        *descend(growth, int(found.children_left[node]), near),
        *descend(growth, int(found.children_right[node]), far),
    ]
    # A part that fails as a whole comes back as itself.
    joined = len(below) == 2 and below[0] is near and below[1] is far
    return [span] if joined else below


def box_bounds(names: Sequence[str], leaf: Leaf, values: Table) -> tuple[Bound, ...]:
    """The sides of a box that are not open, at the outermost values that were seen inside."""
    inside = values[leaf.holds(values)]
    return tuple(
        bound(
            name,
            float(column.min()) if np.isfinite(low) else None,
            float(column.max()) if np.isfinite(high) else None,
        )
        for name, column, low, high in zip(names, inside.T, leaf.low, leaf.high, strict=True)
        if np.isfinite(low) or np.isfinite(high)
    )


def bound(name: str, low: float | None, high: float | None) -> Bound:
    """A bound with its words."""
    thing, _, last = name.rpartition("_")
    unit = UNITS.get(last, "") if thing else ""
    thing = (thing if unit else name).replace("_", " ")
    words = " ".join(filter(None, (thing, between(low, high), unit)))
    return Bound(parameter=name, low=low, high=high, unit=unit, words=words)


def between(low: float | None, high: float | None) -> str:
    """A span in words."""
    if low is None:
        return f"at most {high:.4g}"
    if high is None:
        return f"at least {low:.4g}"
    return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
