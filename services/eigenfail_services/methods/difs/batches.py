"""Trajectories as tensors, on their way into training."""

from typing import NamedTuple

import torch
from torch import Tensor


class Trajectories(NamedTuple):
    """See `Examples`: z of shape (n, horizon, 2), unseen (n, horizon), condition (n,).

    `mean` is that of the component of the mixture that a trajectory is of, shape (n, size).
    """

    z: Tensor
    unseen: Tensor
    condition: Tensor
    mean: Tensor

    def only(self, rows: Tensor) -> "Trajectories":
        """Some of them, by their numbers or by whether they are wanted."""
        return Trajectories(self.z[rows], self.unseen[rows], self.condition[rows], self.mean[rows])


class Noised(NamedTuple):
    """Trajectories at a diffusion time, and what is to be predicted for them.

    Attributes:
        x: x_t, shape (n, size).
        angle: t, shape (n,).
        condition: robustness ÷ scale, shape (n,).
        left: the velocity without what the mixture explains, shape (n, size).
    """

    x: Tensor
    angle: Tensor
    condition: Tensor
    left: Tensor


def shifted(z: Tensor, unseen: Tensor, by: Tensor) -> tuple[Tensor, Tensor]:
    """Each trajectory some steps later; what moves in from outside is unseen.

    Args:
        z: shape (n, horizon, 2).
        unseen: shape (n, horizon).
        by: how many steps, below 0 for earlier, shape (n, 1).
    """
    source = torch.arange(unseen.shape[1], device=z.device) - by.long()
    inside = source.clamp(0, unseen.shape[1] - 1)
    moved = torch.gather(z, 1, inside[..., None].expand_as(z))
    return moved, torch.gather(unseen, 1, inside) | (source != inside)
