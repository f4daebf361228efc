"""The failing region among a scenario's parameters: the boxes of a small decision tree.

The tree is grown on one half of the episodes (CART: Breiman, Friedman, Olshen and Stone 1984).
Every figure comes from the second half, so that chance findings of the tree are not counted (honest
trees: Athey and Imbens 2016, PNAS 113, 7353–7360).
"""

from collections.abc import Sequence
from math import ceil
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenfail.values.estimates import Rate
from eigenfail_failing_region.values import Bound, Box, Region
from eigenfail_services.analysis.sampling_design import SamplingDesign

if TYPE_CHECKING:
    from sklearn.tree import DecisionTreeClassifier

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


class _Leaf(NamedTuple):
    """A box: values above `low` and at most `high`, one of each for a parameter; ±inf is open."""

    low: Table
    high: Table

    def holds(self, values: Table) -> Flags:
        """Return which rows are inside, shape (n,)."""
        within = (values > self.low) & (values <= self.high)
        inside: Flags = np.logical_and.reduce(within, axis=1)
        return inside

    def cut(self, parameter: int, at: float) -> tuple["_Leaf", "_Leaf"]:
        """The part at most there, and the part above."""
        high, low = self.high.copy(), self.low.copy()
        high[parameter] = min(high[parameter], at)
        low[parameter] = max(low[parameter], at)
        return _Leaf(self.low, high), _Leaf(low, self.high)


class _GrownTree(NamedTuple):
    """A tree and the episodes that it was grown on.

    Attributes:
        tree: decision tree of scikit-learn.
        values: shape (rows, parameters).
        failed: shape (rows,).
    """

    tree: "DecisionTreeClassifier"
    values: Table
    failed: Flags

    def fails(self, leaf: _Leaf) -> bool:
        """Return whether episodes in a box fail more often than all episodes."""
        inside = leaf.holds(self.values)
        return bool(inside.any() and self.failed[inside].mean() > self.failed.mean())


def _list_failing_leaves(growth: _GrownTree) -> list[_Leaf]:
    """The boxes that fail more often than the whole; neighbours that both do are one."""
    width = growth.values.shape[1]
    whole = _Leaf(np.full(width, -np.inf), np.full(width, np.inf))
    return _descend(growth, 0, whole)


def _descend(growth: _GrownTree, node: int, span: _Leaf) -> list[_Leaf]:
    """Return the failing boxes below a node, or the node's own box if all of it fails."""
    found = growth.tree.tree_
    if found.children_left[node] < 0:
        return [span] if growth.fails(span) else []
    near, far = span.cut(int(found.feature[node]), float(found.threshold[node]))
    below = [
        *_descend(growth, int(found.children_left[node]), near),
        *_descend(growth, int(found.children_right[node]), far),
    ]
    # A part that fails as a whole comes back as itself.
    joined = len(below) == 2 and below[0] is near and below[1] is far
    return [span] if joined else below


def _make_bounds(names: Sequence[str], leaf: _Leaf, values: Table) -> tuple[Bound, ...]:
    """The sides of a box that are not open, at the outermost values that were seen inside."""
    inside = values[leaf.holds(values)]
    return tuple(
        describe_bound(
            name,
            float(column.min()) if np.isfinite(low) else None,
            float(column.max()) if np.isfinite(high) else None,
        )
        for name, column, low, high in zip(names, inside.T, leaf.low, leaf.high, strict=True)
        if np.isfinite(low) or np.isfinite(high)
    )


def describe_bound(name: str, low: float | None, high: float | None) -> Bound:
    """A bound with its words."""
    thing, _, last = name.rpartition("_")
    unit = UNITS.get(last, "") if thing else ""
    thing = (thing if unit else name).replace("_", " ")
    words = " ".join(filter(None, (thing, _describe_range(low, high), unit)))
    return Bound(parameter=name, low=low, high=high, unit=unit, words=words)


def _describe_range(low: float | None, high: float | None) -> str:
    """A span in words."""
    if low is None:
        return f"at most {high:.4g}"
    if high is None:
        return f"at least {low:.4g}"
    return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"


DEPTH = 3
LEAST_OF_EACH = 20
"""Failures, and episodes without one, below which nothing is tried."""

LEAST_LEAF = 10
LEAF_SHARE = 0.01
SIGNIFICANCE = 0.01
"""Chance alone gives a region in one of a hundred cases."""

SEED = 0


class RegionQuestion(NamedTuple):
    """Episodes by their parameters and outcome.

    Attributes:
        campaigns: whose they are.
        scenario: its name.
        names: names of the parameters that took more than one value.
        values: values of the parameters, shape (episodes, parameters).
        failed: shape (episodes,).
        warnings: known reasons to doubt the answer.
        design: how the episodes came about.
        errored: number of episodes that errored: they are in no row, and may hide failures in any
            part.
    """

    campaigns: tuple[int, ...]
    scenario: str
    names: tuple[str, ...]
    values: Table
    failed: Flags
    warnings: tuple[str, ...] = ()
    design: SamplingDesign = SamplingDesign(())
    errored: int = 0


def find_failing_region(asked: RegionQuestion) -> Region:
    """Return the boxes with a raised failure rate, or the reason why there are none."""
    if problem := _find_obstacle(asked):
        return _make_empty_region(asked, problem)
    grown, held = split_in_halves(asked.failed)
    leaves = _list_failing_leaves(_grow_tree(asked, grown))
    rows = [held[leaf.holds(asked.values[held])] for leaf in leaves]
    if not rows:
        return _make_empty_region(asked, "No part fails more often than the whole. " + MORE)
    return _make_region(asked, leaves, rows, held)


MORE = "Give it more episodes, or vary other parameters, or vary them further."


def _find_obstacle(asked: RegionQuestion) -> str:
    """Return why the region cannot be computed; empty if it can."""
    failures, episodes = int(asked.failed.sum()), len(asked.failed)
    if not asked.names:
        return (
            "No scenario parameter took more than one value. Give one a distribution, such as "
            "scenario_parameters.distance_m = { uniform = [52.0, 70.0] }, or name the campaigns of "
            "a grid."
        )
    if min(failures, episodes - failures) < LEAST_OF_EACH:
        return (
            f"{failures} of {episodes} episodes failed: it takes {LEAST_OF_EACH} that did and "
            f"{LEAST_OF_EACH} that did not. Give it more episodes."
        )
    return ""


def _make_empty_region(asked: RegionQuestion, problem: str) -> Region:
    """Return a region without a box, with the reasons in sentences."""
    return Region(
        campaigns=asked.campaigns,
        scenario=asked.scenario,
        parameters=asked.names,
        episodes=len(asked.failed),
        failures=int(asked.failed.sum()),
        failure_rate=_make_rate(asked, int(asked.failed.sum()), len(asked.failed))
        if len(asked.failed)
        else None,
        problem=problem,
        warnings=asked.warnings,
    )


def _make_rate(asked: RegionQuestion, k: int, n: int) -> Rate:
    """Return k of n rows; an errored episode may belong to any part, with or without a failure."""
    return asked.design.make_rate(k, n, asked.errored)


def split_in_halves(failed: Flags) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows to grow on and rows to judge by, with half of the failures in each; seeded."""
    random = np.random.default_rng(SEED)
    # Failures and others apart: with few failures one half might get hardly any.
    mixed = [random.permutation(np.flatnonzero(failed == kind)) for kind in (True, False)]
    parts = [np.concatenate([each[start::2] for each in mixed]) for start in (0, 1)]
    return np.sort(parts[0]), np.sort(parts[1])


def _grow_tree(asked: RegionQuestion, rows: NDArray[np.intp]) -> _GrownTree:
    """A tree on some of the episodes; the same for the same episodes."""
    # scikit-learn takes a second to load, and most regions that a report of the API asks for are of
    # campaigns whose parameters do not vary.
    from sklearn.tree import DecisionTreeClassifier

    least = max(LEAST_LEAF, ceil(LEAF_SHARE * len(rows)))
    tree = DecisionTreeClassifier(max_depth=DEPTH, min_samples_leaf=least, random_state=SEED)
    values, failed = asked.values[rows], asked.failed[rows]
    return _GrownTree(tree.fit(values, failed), values, failed)


def _make_region(
    asked: RegionQuestion, leaves: list[_Leaf], rows: list[NDArray[np.intp]], held: NDArray[np.intp]
) -> Region:
    """The region with its figures, unless chance explains it as well."""
    from scipy.stats import hypergeom  # imported late, as above

    inside, failed = np.concatenate(rows), asked.failed
    all_failures = int(failed[held].sum())
    k, n = int(failed[inside].sum()), len(inside)
    # Fisher's exact test, one-sided: k or more of the failures inside, were all rows alike.
    p_value = float(hypergeom.sf(k - 1, len(held), all_failures, n))
    if p_value > SIGNIFICANCE:
        return _make_empty_region(
            asked,
            f"No part fails more often than chance explains (p = {p_value:.2g}; it takes "
            f"{SIGNIFICANCE:g}). {MORE}",
        )
    boxes = [
        _make_box(asked, leaf, own, all_failures) for leaf, own in zip(leaves, rows, strict=True)
    ]
    return Region(
        campaigns=asked.campaigns,
        scenario=asked.scenario,
        parameters=asked.names,
        episodes=len(failed),
        failures=int(failed.sum()),
        failure_rate=_make_rate(asked, all_failures, len(held)),
        boxes=tuple(sorted(boxes, key=lambda one: (-one.coverage.k, one.words))),
        coverage=_make_rate(asked, k, all_failures),
        precision=_make_rate(asked, k, n),
        p_value=p_value,
        warnings=asked.warnings,
    )


def _make_box(asked: RegionQuestion, leaf: _Leaf, rows: NDArray[np.intp], all_failures: int) -> Box:
    """Return a leaf with its figures, from the held-out rows inside it."""
    k = int(asked.failed[rows].sum())
    bounds = _make_bounds(asked.names, leaf, asked.values)
    return Box(
        bounds=bounds,
        words=", ".join(each.words for each in bounds),
        coverage=_make_rate(asked, k, all_failures),
        precision=_make_rate(asked, k, len(rows)) if len(rows) else None,
    )
