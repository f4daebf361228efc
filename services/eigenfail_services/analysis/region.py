"""The failing region among a scenario's parameters: a small decision tree, told as boxes.

The tree is grown on one half of the episodes (CART: Breiman, Friedman, Olshen and Stone 1984) and
every figure comes from the other half, so that what the tree took from chance is not counted
(honest trees: Athey and Imbens 2016, PNAS 113, 7353–7360).
"""

from math import ceil
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import hypergeom
from sklearn.tree import DecisionTreeClassifier

from eigenfail.values import Box, Region
from eigenfail_services.analysis.boxes import Growth, Leaf, box_bounds, failing_leaves
from eigenfail_services.analysis.safety import share
from eigenfail_services.statistics.intervals import rate

Table = NDArray[np.float64]
Flags = NDArray[np.bool_]

DEPTH = 3
LEAST_OF_EACH = 20
"""Failures, and episodes without one, below which nothing is tried."""

LEAST_LEAF = 10
LEAF_SHARE = 0.01
LEVEL = 0.01
"""Chance alone gives a region in one of a hundred cases."""

SEED = 0


class Question(NamedTuple):
    """Episodes by their parameters and outcome.

    Attributes:
        campaigns: whose they are.
        scenario: its name.
        names: of the parameters that took more than one value.
        values: of these, shape (episodes, parameters).
        failed: shape (episodes,).
        warnings: what is already known to speak against the answer.
    """

    campaigns: tuple[int, ...]
    scenario: str
    names: tuple[str, ...]
    values: Table
    failed: Flags
    warnings: tuple[str, ...] = ()


def failing_region(asked: Question) -> Region:
    """The boxes in which episodes fail more often, or why none can be told."""
    if problem := obstacle(asked):
        return without_boxes(asked, problem)
    grown, held = halves(asked.failed)
    leaves = failing_leaves(grow(asked, grown))
    rows = [held[leaf.holds(asked.values[held])] for leaf in leaves]
    if not rows:
        return without_boxes(asked, "No part fails more often than the whole. " + MORE)
    return told(asked, leaves, rows, held)


MORE = "Give it more episodes, or vary other parameters, or vary them further."


def obstacle(asked: Question) -> str:
    """Why nothing can be tried; empty if it can."""
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


def without_boxes(asked: Question, problem: str) -> Region:
    """What can be said without a region."""
    return Region(
        campaigns=asked.campaigns,
        scenario=asked.scenario,
        parameters=asked.names,
        episodes=len(asked.failed),
        failures=int(asked.failed.sum()),
        failure_rate=share(int(asked.failed.sum()), len(asked.failed)),
        problem=problem,
        warnings=asked.warnings,
    )


def halves(failed: Flags) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows to grow on and rows to judge by, with half of the failures in each; seeded."""
    random = np.random.default_rng(SEED)
    mixed = [random.permutation(np.flatnonzero(failed == kind)) for kind in (True, False)]
    parts = [np.concatenate([each[start::2] for each in mixed]) for start in (0, 1)]
    return np.sort(parts[0]), np.sort(parts[1])


def grow(asked: Question, rows: NDArray[np.intp]) -> Growth:
    """A tree on some of the episodes; the same for the same episodes."""
    least = max(LEAST_LEAF, ceil(LEAF_SHARE * len(rows)))
    tree = DecisionTreeClassifier(max_depth=DEPTH, min_samples_leaf=least, random_state=SEED)
    values, failed = asked.values[rows], asked.failed[rows]
    return Growth(tree.fit(values, failed), values, failed)


def told(
    asked: Question, leaves: list[Leaf], rows: list[NDArray[np.intp]], held: NDArray[np.intp]
) -> Region:
    """The region with its figures, unless chance explains it as well."""
    inside, failed = np.concatenate(rows), asked.failed
    all_failures = int(failed[held].sum())
    k, n = int(failed[inside].sum()), len(inside)
    p_value = float(hypergeom.sf(k - 1, len(held), all_failures, n))
    if p_value > LEVEL:
        return without_boxes(
            asked,
            f"No part fails more often than chance explains (p = {p_value:.2g}; it takes "
            f"{LEVEL:g}). {MORE}",
        )
    boxes = [box(asked, leaf, own, all_failures) for leaf, own in zip(leaves, rows, strict=True)]
    return Region(
        campaigns=asked.campaigns,
        scenario=asked.scenario,
        parameters=asked.names,
        episodes=len(failed),
        failures=int(failed.sum()),
        failure_rate=rate(all_failures, len(held)),
        boxes=tuple(sorted(boxes, key=lambda one: (-one.coverage.k, one.words))),
        coverage=rate(k, all_failures),
        precision=rate(k, n),
        p_value=p_value,
        warnings=asked.warnings,
    )


def box(asked: Question, leaf: Leaf, rows: NDArray[np.intp], all_failures: int) -> Box:
    """A leaf with its figures, over the rows inside of those to judge by."""
    k = int(asked.failed[rows].sum())
    bounds = box_bounds(asked.names, leaf, asked.values)
    return Box(
        bounds=bounds,
        words=", ".join(each.words for each in bounds),
        coverage=rate(k, all_failures),
        precision=share(k, len(rows)),
    )
