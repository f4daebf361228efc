"""The diffusion process: x_t = cos(t) · x_0 + sin(t) · eps, t from 0 (data) to pi/2 (noise)."""

from collections.abc import Callable
from itertools import pairwise
from math import pi

import torch
from torch import Tensor

Velocity = Callable[[Tensor, Tensor], Tensor]
"""v(x, t) for x of shape (n, size) and t of shape (n,)."""


def diffuse(x0: Tensor, eps: Tensor, angle: Tensor) -> Tensor:
    """x_t, shape (n, size)."""
    return torch.cos(angle)[:, None] * x0 + torch.sin(angle)[:, None] * eps


def velocity(x0: Tensor, eps: Tensor, angle: Tensor) -> Tensor:
    """The target v = cos(t) · eps - sin(t) · x_0 (Salimans and Ho 2022), shape (n, size)."""
    return torch.cos(angle)[:, None] * eps - torch.sin(angle)[:, None] * x0


def angles(steps: int) -> Tensor:
    """The times that the sampler visits, from pi/2 to 0, shape (steps + 1,)."""
    return torch.linspace(pi / 2, 0.0, steps + 1, dtype=torch.float64)


def sample(v: Velocity, start: Tensor, steps: int, generator: torch.Generator) -> Tensor:
    """Samples of x_0, by `steps` ancestral steps of DDIM with the wide variance.

    From t to s: x_s ~ N(rho · x_t - cos(s) · (1 - rho²) / sin(t) · v, 1 - rho²) with
    rho = cos(t) / cos(s): the posterior mean for the x_0 that v predicts, and the variance that is
    exact for data of unit variance (Ho et al. 2020, sec. 3.2). So any normal with unit variance is
    sampled exactly in however few steps, and what v does not change stays distributed as the prior.

    Args:
        v: predicts the velocity.
        start: standard normal draws, shape (n, size).
        steps: number of steps.
        generator: of the noise.
    """
    x, times = start, angles(steps)
    for t, s in pairwise(times):
        rho = torch.cos(t) / torch.cos(s) if t < times[0] else torch.zeros((), dtype=t.dtype)
        pull = torch.cos(s) * (1.0 - rho**2) / torch.sin(t)
        angle = torch.full((len(x),), float(t), dtype=x.dtype, device=x.device)
        noise = torch.randn(x.shape, generator=generator, dtype=x.dtype, device=x.device)
        x = float(rho) * x - float(pull) * v(x, angle) + float(torch.sqrt(1.0 - rho**2)) * noise
    return x
