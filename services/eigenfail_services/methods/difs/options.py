"""What the diffusion model is told; free of torch."""

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.values import Floats


class DiffusionOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Settings of the diffusion model; see `DifsSettings`."""

    horizon: int
    width: int
    learning_rate: float
    weight_decay: float
    batch_size: int
    ema: float
    jitter: int
    sampler: str
    sampling_steps: int
    device: str
    seed: int


class Examples(msgspec.Struct, frozen=True, eq=False):
    """Training data.

    Attributes:
        z: trajectories, shape (n, horizon, 2). [sigma]
        unseen: whether a trajectory has no noise of its own in a step, shape (n, horizon).
        condition: robustness ÷ scale, shape (n,).
        held_out: whether the network shall not be trained on it, but judged by it, shape (n,).
        modes: how many components the mixture may have.
    """

    z: Floats
    unseen: NDArray[np.bool_]
    condition: Floats
    held_out: NDArray[np.bool_]
    modes: int
