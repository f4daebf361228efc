"""The probability of each failure mode from the last level of subset simulations."""

from collections.abc import Mapping, Sequence
from math import inf

import numpy as np
from numpy.typing import NDArray

from eigenfail.values import Estimate
from eigenfail_services.methods.subset.waves import Dialogue, Waves
from eigenfail_services.statistics.conditional_sampling import Chains
from eigenfail_services.statistics.independent_runs import pooled, refused
from eigenfail_services.statistics.subset_estimate import End, SubsetEstimate
from eigenfail_services.statistics.subset_simulation import (
    level,
    lineage_variation,
    not_reached,
    reached,
)

FEWEST_LINEAGES = 5.0
"""Independent first draws that the failures of a mode must be worth: of fewer, that the mode was
found at all is luck, and so is its share."""

NONE = -1


def by_mode(
    dialogues: Sequence[Dialogue],
    robustness: Sequence[float],
    mode_of: Mapping[int, int],
    modes: int,
) -> tuple[Estimate, ...] | None:
    """P of each mode: P of the last level but one, times the share of the last one in the mode.

    Args:
        dialogues: fresh, those that asked for the episodes; they are run again.
        robustness: of each episode in index order, 0 of a failure. [m]
        mode_of: the mode of each failure, by the index of its episode.
        modes: how many there are.

    Returns:
        None unless all simulations came to failures.
    """
    index_of = play(dialogues, robustness)
    chains = [each.simulation.chains for each in dialogues]
    if any(each is None for each in chains):
        return None
    found = [labels(each, index_of, mode_of) for each in chains if each is not None]
    return tuple(estimate(dialogues, found, mode) for mode in range(modes))


def play(dialogues: Sequence[Dialogue], robustness: Sequence[float]) -> dict[bytes, int]:
    """Go through the episodes again; the index of each failure, by its noise."""
    waves, index_of, heard = Waves(dialogues), dict[bytes, int](), 0
    while len(waves.wave) and heard + len(waves.wave) <= len(robustness):
        values = robustness[heard : heard + len(waves.wave)]
        failed = np.flatnonzero(np.array(values) <= 0.0).tolist()
        index_of |= {waves.wave[row].tobytes(): heard + row for row in failed}
        heard += len(values)
        waves.hear(values)
    return index_of


def labels(
    chains: Chains, index_of: Mapping[bytes, int], mode_of: Mapping[int, int]
) -> NDArray[np.int64]:
    """The mode of each sample of a level, shape (length, chains); -1 of what is no failure."""
    found = np.full(chains.values.shape, NONE)
    for place in np.argwhere(chains.values <= 0.0).tolist():
        index = index_of[chains.z[tuple(place)].tobytes()]
        found[tuple(place)] = mode_of.get(index, NONE)
    return found


def estimate(
    dialogues: Sequence[Dialogue], found: Sequence[NDArray[np.int64]], mode: int
) -> Estimate:
    """The estimate of one mode, or why there is none."""
    each = [alone(one, own == mode) for one, own in zip(dialogues, found, strict=True)]
    worth = sum(
        lineages(one.simulation.chains, own == mode)
        for one, own in zip(dialogues, found, strict=True)
    )
    if worth < FEWEST_LINEAGES:
        episodes = sum(one.evaluations for one in each)
        problem = (
            f"Its failures on the last level are worth {worth:.1f} independent first draws, and it "
            f"takes {FEWEST_LINEAGES:.0f}. Give the campaign more episodes."
        )
        return refused(episodes, problem)
    return pooled(each, found[0].size)


def alone(dialogue: Dialogue, inside: NDArray[np.bool_]) -> SubsetEstimate:
    """What a simulation would have found if only these samples of its last level were failures.

    Args:
        dialogue: with the simulation.
        inside: whether each sample is one of these, shape (length, chains).
    """
    simulation = dialogue.simulation
    chains = simulation.chains
    if chains is None or not inside.any():
        return not_reached(simulation.levels, End.STALLED, simulation.evaluations)
    own = chains._replace(values=np.where(inside, 0.0, inf))
    levels = (*simulation.levels[:-1], level(own, 0.0))
    return reached(levels, own, simulation.evaluations)


def lineages(chains: Chains | None, inside: NDArray[np.bool_]) -> float:
    """How many independent first draws some samples are worth: (sum d)² ÷ sum d² (Kish 1965).

    Args:
        chains: of a level; None if there is none.
        inside: which of its samples, shape (length, chains).
    """
    if chains is None or not inside.any():
        return 0.0
    descendants = np.bincount(chains.ancestors, inside.sum(axis=0))
    return lineage_variation(descendants) ** -2
