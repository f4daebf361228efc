"""The probability of each failure mode from the last level of subset simulations."""

from collections.abc import Mapping, Sequence
from math import inf

import numpy as np
from numpy.typing import NDArray

from eigenfail.values import Estimate
from eigenfail_services.methods.subset.method import SimulationRun, WaveQueue
from eigenfail_services.statistics.pooled_estimate import pool_simulations, refuse_estimate
from eigenfail_services.statistics.subset_simulation import (
    Chains,
    SubsetEnd,
    SubsetEstimate,
    estimate_from_failures,
    estimate_lineage_variation,
    estimate_without_failures,
    make_level,
)

MIN_LINEAGES = 5.0
"""Least number of effective independent first draws behind the failures of a mode: with fewer, both
the mode and its share are due to chance."""

NONE = -1


def estimate_modes(
    runs: Sequence[SimulationRun],
    robustness: Sequence[float],
    mode_of: Mapping[int, int],
    modes: int,
) -> tuple[Estimate, ...] | None:
    """Return P of each mode: P of the last level but one, times the mode's share in the last one.

    Args:
        runs: new runs of the simulations that requested the episodes; they are run again.
        robustness: of each episode in index order, 0 of a failure. [m]
        mode_of: mode of each failure, by the index of its episode.
        modes: number of modes.

    Returns:
        None unless all simulations reached failures.
    """
    index_of = replay_waves(runs, robustness)
    chains = [each.simulation.chains for each in runs]
    if any(each is None for each in chains):
        return None
    found = [label_samples(each, index_of, mode_of) for each in chains if each is not None]
    return tuple(_estimate_mode(runs, found, mode) for mode in range(modes))


def replay_waves(runs: Sequence[SimulationRun], robustness: Sequence[float]) -> dict[bytes, int]:
    """Run the simulations again; return the index of each failure by its noise."""
    waves, index_of, count = WaveQueue(runs), dict[bytes, int](), 0
    while len(waves.wave) and count + len(waves.wave) <= len(robustness):
        values = robustness[count : count + len(waves.wave)]
        failed = np.flatnonzero(np.array(values) <= 0.0).tolist()
        index_of |= {waves.wave[row].tobytes(): count + row for row in failed}
        count += len(values)
        waves.add_robustness(values)
    return index_of


def label_samples(
    chains: Chains, index_of: Mapping[bytes, int], mode_of: Mapping[int, int]
) -> NDArray[np.int64]:
    """Return the mode of each sample of a level, shape (length, chains); -1 for no failure."""
    found = np.full(chains.values.shape, NONE)
    for place in np.argwhere(chains.values <= 0.0).tolist():
        index = index_of[chains.z[tuple(place)].tobytes()]
        found[tuple(place)] = mode_of.get(index, NONE)
    return found


def _estimate_mode(
    runs: Sequence[SimulationRun], found: Sequence[NDArray[np.int64]], mode: int
) -> Estimate:
    """Return the estimate of one mode, or the reason why there is none."""
    each = [_restrict_to_mode(one, own == mode) for one, own in zip(runs, found, strict=True)]
    worth = sum(
        count_lineages(one.simulation.chains, own == mode)
        for one, own in zip(runs, found, strict=True)
    )
    if worth < MIN_LINEAGES:
        episodes = sum(one.evaluations for one in each)
        problem = (
            f"Its failures on the last level are worth {worth:.1f} independent first draws, and it "
            f"takes {MIN_LINEAGES:.0f}. Give the campaign more episodes."
        )
        return refuse_estimate(episodes, problem)
    return pool_simulations(each, found[0].size)


def _restrict_to_mode(run: SimulationRun, inside: NDArray[np.bool_]) -> SubsetEstimate:
    """Return a simulation's estimate if only some samples of its last level were failures.

    Args:
        run: of the simulation.
        inside: mask of these samples, shape (length, chains).
    """
    simulation = run.simulation
    chains = simulation.chains
    if chains is None or not inside.any():
        return estimate_without_failures(
            simulation.levels, SubsetEnd.STALLED, simulation.evaluations
        )
    own = chains._replace(values=np.where(inside, 0.0, inf))
    levels = (*simulation.levels[:-1], make_level(own, 0.0))
    return estimate_from_failures(levels, own, simulation.evaluations)


def count_lineages(chains: Chains | None, inside: NDArray[np.bool_]) -> float:
    """Return the effective number of first draws behind samples: (sum d)² ÷ sum d² (Kish 1965).

    Args:
        chains: of a level; None without a level.
        inside: mask of its samples, shape (length, chains).
    """
    if chains is None or not inside.any():
        return 0.0
    descendants = np.bincount(chains.ancestors, inside.sum(axis=0))
    return estimate_lineage_variation(descendants) ** -2
