"""Choice of the trajectories that a mixture is fitted to, equally many of each component."""

from math import ceil

import numpy as np

from eigenfail_searches.mixture_ce.modes import Rows
from eigenfail_services.methods.trials import TrialMemory

PATIENCE = 2
"""A component without failures is dropped after this number of elites of failures elsewhere."""


def select_elite(trials: TrialMemory, count: int, likely_share: float, components: Rows) -> Rows:
    """Return the best trajectories, equally many of each component.

    A few dozen failures do not show which component has more of p(z | failure). A component that
    has more by chance would soon displace the others.

    Args:
        trials: trajectories.
        count: number of trajectories that are returned.
        likely_share: share of a component's newest failures that are selected by likelihood.
        components: number of the component of each trajectory, shape (n,).
    """
    kept = _list_components(trials, count, components)
    # Rounded up, so that every component has a part.
    each = ceil(count / len(kept))
    return np.concatenate([_select_best(trials, rows, each, likely_share) for rows in kept])


def has_elites(trials: TrialMemory, count: int, components: Rows) -> bool:
    """Whether each component has enough failures for its part of an elite of `count`."""
    kept = _list_components(trials, count, components)
    return all(len(_find_failures(trials, rows)) >= count / len(kept) for rows in kept)


def _list_components(trials: TrialMemory, count: int, components: Rows) -> list[Rows]:
    """Return each component's trajectories; with enough failures, only of those that failed."""
    each = [np.flatnonzero(components == component) for component in np.unique(components)]
    # So few failures do not show that a component has none.
    if np.count_nonzero(trials.robustness <= 0.0) < PATIENCE * count:
        return each
    return [rows for rows in each if len(_find_failures(trials, rows))]


def _find_failures(trials: TrialMemory, rows: Rows) -> Rows:
    return rows[trials.robustness[rows] <= 0.0]


def _select_best(trials: TrialMemory, rows: Rows, count: int, likely_share: float) -> Rows:
    """Return the least robust ones; of more than `count` failures, the likelier of the newest.

    Likelihood is measured along their common mean m, by -z·m: that is log p - log q for a
    proposal q = N(m, 1), up to a constant. By log p alone, noise in directions that do not
    matter would decide. The newest come from proposals with less of such noise.
    """
    failures = _find_failures(trials, rows)
    if len(failures) <= count:
        return rows[np.argsort(trials.robustness[rows], kind="stable")[:count]]
    newest = failures[-ceil(count / likely_share) :]
    z = trials.z[newest].reshape(len(newest), -1)
    return newest[np.argsort(z @ z.mean(axis=0), kind="stable")[:count]]
