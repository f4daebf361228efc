"""What the network of `difs` is trained on: noise, with its robustness and its likelihood."""

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.values.arrays import Floats

LARGEST_CONDITION = 10.0
"""Largest condition: robustness far from failures is all alike, and must not dominate."""


class LabelledNoise(msgspec.Struct, frozen=True, eq=False):
    """Training data.

    Attributes:
        z: trajectories, shape (n, horizon, channels). [sigma]
        unseen: whether no noise was injected in a step, shape (n, horizon).
        condition: robustness ÷ scale, within 0 and `LARGEST_CONDITION`, shape (n,).
        excess: excess of the squared noise over p(x), shape (n,); see `compute_excess`.
        weights: chance of each trajectory in the elite's part of a batch, shape (n,). It is 0
            outside the elite.
    """

    z: Floats
    unseen: NDArray[np.bool_]
    condition: Floats
    excess: Floats
    weights: NDArray[np.float64]


def compute_excess(z: Floats, unseen: NDArray[np.bool_]) -> Floats:
    """Return (sum z² - d) / sqrt(2 d) over the d injected values of each trajectory, shape (n,).

    Under p(x) it has mean 0 and standard deviation 1: noise with a large excess is unlikely.

    Args:
        z: shape (n, horizon, channels). [sigma]
        unseen: whether no noise was injected in a step, shape (n, horizon).
    """
    numbers = np.maximum((~unseen).sum(axis=1) * z.shape[2], 1).astype(np.float64)
    squares = np.where(unseen[..., None], 0.0, z.astype(np.float64) ** 2).sum(axis=(1, 2))
    excess: Floats = ((squares - numbers) / np.sqrt(2.0 * numbers)).astype(np.float32)
    return excess


FEWEST_MOVED = 5
"""With fewer moved trajectories in the elite, all of the elite have the same weight."""


def weigh_elite(elite: NDArray[np.bool_], moved: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the chance of each trajectory in the elite's part of a batch, shape (n,).

    Half of it is moved trajectories, if there are enough: they are spread over all regions of
    failures. A network that learns from its own samples alone keeps ever fewer of the regions.

    Args:
        elite: whether a trajectory is one of the elite, shape (n,).
        moved: whether it was moved, shape (n,).
    """
    own, spread = elite & ~moved, elite & moved
    if np.count_nonzero(spread) < FEWEST_MOVED or not own.any():
        weights: NDArray[np.float64] = elite / np.count_nonzero(elite)
        return weights
    return 0.5 * own / np.count_nonzero(own) + 0.5 * spread / np.count_nonzero(spread)


def move(z: Floats, random: np.random.Generator) -> Floats:
    """Shift each trajectory in time, and give each of its channels a random sign.

    A shift is drawn uniformly from all shifts that keep at least one step. Steps without shifted
    noise get new draws. Noise from p(x) stays noise from p(x).

    Args:
        z: shape (n, horizon, channels). [sigma]
        random: generator of shifts, signs and new draws.
    """
    count, horizon, channels = z.shape
    by = random.integers(1 - horizon, horizon, size=(count, 1))
    source = np.arange(horizon) - by
    inside = (source >= 0) & (source < horizon)
    shifted = np.take_along_axis(z, np.clip(source, 0, horizon - 1)[..., None], axis=1)
    fresh = random.standard_normal(z.shape, np.float32)
    signs = random.choice(np.array([-1.0, 1.0], np.float32), size=(count, 1, channels))
    moved: Floats = np.where(inside[..., None], shifted, fresh) * signs
    return moved
