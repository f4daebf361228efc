"""What the diffusion model is told; free of torch."""

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.values import Floats


class DiffusionOptions(msgspec.Struct, frozen=True):
    """Settings of the diffusion model; see `DifsSettings`."""

    horizon: int
    width: int
    learning_rate: float
    weight_decay: float
    batch_size: int
    ema: float
    dropout: float
    sampling_steps: int
    shrink: float
    device: str
    seed: int


class Examples(msgspec.Struct, frozen=True, eq=False):
    """Training data.

    Attributes:
        z: trajectories, shape (n, horizon · 2).
        unseen: 1 where a trajectory has no noise of its own, shape (n, horizon · 2).
        condition: robustness ÷ scale, shape (n,).
        weights: how often each is drawn, relative to the others, shape (n,).
    """

    z: Floats
    unseen: Floats
    condition: Floats
    weights: NDArray[np.float64]
