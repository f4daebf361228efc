"""The diffusion process: x_t = cos(t) · x_0 + sin(t) · eps, t from 0 (data) to pi/2 (noise)."""

import torch
from torch import Tensor


def diffuse(x0: Tensor, eps: Tensor, angle: Tensor) -> Tensor:
    """x_t, shape (n, size)."""
    return torch.cos(angle)[:, None] * x0 + torch.sin(angle)[:, None] * eps


def velocity(x0: Tensor, eps: Tensor, angle: Tensor) -> Tensor:
    """The target v = cos(t) · eps - sin(t) · x_0 (Salimans and Ho 2022), shape (n, size)."""
    return torch.cos(angle)[:, None] * eps - torch.sin(angle)[:, None] * x0
