"""Ways from noise to data, once a velocity is known; see `SAMPLERS`."""

from collections.abc import Callable
from itertools import pairwise
from math import cos, inf, log, pi, sin, sqrt, tan

import numpy as np
import torch
from torch import Tensor

Velocity = Callable[[Tensor, Tensor], Tensor]
"""v(x, t) for x of shape (n, size) and t of shape (n,)."""

Sampler = Callable[[Velocity, Tensor, int, torch.Generator], Tensor]
"""(v, standard normal draws, steps, generator) to samples of x_0."""

DDPM_STEPS = 1000


def angles(steps: int) -> list[float]:
    """The times that a sampler visits, steps + 1 of them from pi/2 to 0."""
    times: list[float] = np.linspace(pi / 2, 0.0, steps + 1).tolist()
    return times


def ancestral(v: Velocity, start: Tensor, steps: int, generator: torch.Generator) -> Tensor:
    """Samples of x_0, by `steps` ancestral steps of DDPM with the wide variance.

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
    x = start
    for t, s in pairwise(angles(steps)):
        rho = cos(t) / cos(s) if t < pi / 2 else 0.0
        pull = cos(s) * (1.0 - rho**2) / sin(t)
        noise = torch.randn(x.shape, generator=generator, dtype=x.dtype, device=x.device)
        x = rho * x - pull * v(x, _each(x, t)) + sqrt(1.0 - rho**2) * noise
    return x


def full(v: Velocity, start: Tensor, _steps: int, generator: torch.Generator) -> Tensor:
    """The same in the 1000 steps of the original, whatever the number asked for."""
    return ancestral(v, start, DDPM_STEPS, generator)


def dpm_solver(v: Velocity, start: Tensor, steps: int, _generator: torch.Generator) -> Tensor:
    """Samples of x_0 by DPM-Solver++(2M) (Lu et al. 2022, algorithm 2): no noise on the way.

    x_s = sin(s) / sin(t) · x_t + cos(s) · (1 - e^-h) · D, where h is the step in
    lambda = log(cot t), and D extrapolates the predicted x_0 over this step and the last one. The
    first and the last step have no finite h and are of first order.
    """
    x, before, h_before = start, start, inf
    for t, s in pairwise(angles(steps)):
        h = _log_cot(s) - _log_cot(t)
        x0 = cos(t) * x - sin(t) * v(x, _each(x, t))
        slope = 0.5 * h / h_before if h < inf and h_before < inf else 0.0
        straight = x0 + slope * (x0 - before)
        left = sin(s) / sin(t)
        x = left * x + (cos(s) - left * cos(t)) * straight
        before, h_before = x0, h
    return x


SAMPLERS: dict[str, Sampler] = {"ancestral": ancestral, "dpm_solver": dpm_solver, "ddpm": full}


def _each(x: Tensor, t: float) -> Tensor:
    return torch.full((len(x),), t, dtype=x.dtype, device=x.device)


def _log_cot(t: float) -> float:
    if t <= 0.0:
        return inf
    return -log(tan(t)) if t < pi / 2 else -inf
