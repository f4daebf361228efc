"""The diffusion process, its network and its samplers.

The process is x_t = cos(t) · x_0 + sin(t) · eps, t from 0 (data) to pi/2 (noise).
"""

from collections.abc import Callable
from itertools import pairwise
from math import cos, inf, log, pi, sin, sqrt, tan
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn


def diffuse(x0: Tensor, eps: Tensor, angle: Tensor) -> Tensor:
    """Return x_t, shape (n, size)."""
    return torch.cos(angle)[:, None] * x0 + torch.sin(angle)[:, None] * eps


def compute_velocity(x0: Tensor, eps: Tensor, angle: Tensor) -> Tensor:
    """Return the target v = cos(t) · eps - sin(t) · x_0 (Salimans and Ho 2022), shape (n, size)."""
    return torch.cos(angle)[:, None] * eps - torch.sin(angle)[:, None] * x0


class Trajectories(NamedTuple):
    """`Examples` as tensors: z of shape (n, horizon, 2), unseen (n, horizon), condition (n,).

    `mean` is that of the trajectory's component of the mixture, shape (n, size).
    """

    z: Tensor
    unseen: Tensor
    condition: Tensor
    mean: Tensor

    def select(self, rows: Tensor) -> "Trajectories":
        """Return some trajectories, by numbers or by a mask."""
        return Trajectories(self.z[rows], self.unseen[rows], self.condition[rows], self.mean[rows])


class NoisedTrajectories(NamedTuple):
    """Trajectories at a diffusion time, and the prediction target.

    Attributes:
        x: x_t, shape (n, size).
        angle: t, shape (n,).
        condition: robustness ÷ scale, shape (n,).
        left: velocity minus that of the mixture, shape (n, size).
    """

    x: Tensor
    angle: Tensor
    condition: Tensor
    left: Tensor


def shift_in_time(z: Tensor, unseen: Tensor, by: Tensor) -> tuple[Tensor, Tensor]:
    """Shift each trajectory in time; steps that move in from outside are unseen.

    Args:
        z: shape (n, horizon, 2).
        unseen: shape (n, horizon).
        by: number of steps, negative for earlier, shape (n, 1).
    """
    source = torch.arange(unseen.shape[1], device=z.device) - by.long()
    inside = source.clamp(0, unseen.shape[1] - 1)
    moved = torch.gather(z, 1, inside[..., None].expand_as(z))
    return moved, torch.gather(unseen, 1, inside) | (source != inside)


FEATURES = 5
"""Four features of the diffusion time, and the condition."""


def _compute_time_features(angle: Tensor) -> Tensor:
    """Return features of the diffusion time, shape (n, 4)."""
    turns = [torch.sin(angle), torch.cos(angle), torch.sin(2 * angle), torch.cos(4 * angle)]
    return torch.stack(turns, dim=1)


class Denoiser(nn.Module):
    """v(x_t, t, r) = -sin(t) · m + trust · correction(x_t, t, r), zero before training.

    For a standard normal v is zero, so that the untrained network samples the prior exactly; for a
    normal with mean m, v = -sin(t) · m exactly. The first term is that mean, of the component of
    the mixture for which a sample is drawn. The second term learns what the mixture does not
    explain: widths, and their dependence on robustness. `trust` is the extent to which it holds for
    held-out trajectories: from a few dozen with hundreds of numbers it would learn coincidences.

    Args:
        size: number of values of a trajectory.
        width: of the hidden layers.
    """

    trust: Tensor

    def __init__(self, size: int, width: int) -> None:
        super().__init__()
        self.register_buffer("trust", torch.zeros(()))
        self.correction = nn.Sequential(
            nn.Linear(size + FEATURES, width),
            nn.SiLU(),
            nn.Linear(width, width),
            nn.SiLU(),
            nn.Linear(width, size),
        )
        for parameter in self.correction[-1].parameters():
            nn.init.zeros_(parameter)

    def forward(self, x: Tensor, angle: Tensor, condition: Tensor, mean: Tensor) -> Tensor:
        """Return v, x and mean of shape (n, size), for angle and condition of shape (n,)."""
        corrected = self.correct(x, angle, condition)
        return self.trust * corrected - torch.sin(angle)[:, None] * mean

    def correct(self, x: Tensor, angle: Tensor, condition: Tensor) -> Tensor:
        """Return the correction, shape (n, size)."""
        seen = torch.cat([x, _compute_time_features(angle), condition[:, None]], dim=1)
        correction: Tensor = self.correction(seen)
        return correction


Velocity = Callable[[Tensor, Tensor], Tensor]
"""v(x, t) for x of shape (n, size) and t of shape (n,)."""

Sampler = Callable[[Velocity, Tensor, int, torch.Generator], Tensor]
"""From (v, standard normal draws, steps, generator) to samples of x_0."""

DDPM_STEPS = 1000


def _list_times(steps: int) -> list[float]:
    """Return the steps + 1 times of a sampler, from pi/2 to 0."""
    times: list[float] = np.linspace(pi / 2, 0.0, steps + 1).tolist()
    return times


def sample_ancestral(v: Velocity, start: Tensor, steps: int, generator: torch.Generator) -> Tensor:
    """Return samples of x_0, by `steps` ancestral steps of DDPM with the wide variance.

    From t to s: x_s ~ N(rho · x_t - cos(s) · (1 - rho²) / sin(t) · v, 1 - rho²) with
    rho = cos(t) / cos(s): the posterior mean for the x_0 that v predicts, and the variance that is
    exact for data of unit variance (Ho et al. 2020, sec. 3.2). So any normal of unit variance is
    sampled exactly in any number of steps, and directions in which v is zero keep the prior.

    Args:
        v: predicts the velocity.
        start: standard normal draws, shape (n, size).
        steps: number of steps.
        generator: of the noise.
    """
    x = start
    for t, s in pairwise(_list_times(steps)):
        rho = cos(t) / cos(s) if t < pi / 2 else 0.0
        pull = cos(s) * (1.0 - rho**2) / sin(t)
        noise = torch.randn(x.shape, generator=generator, dtype=x.dtype, device=x.device)
        x = rho * x - pull * v(x, _each(x, t)) + sqrt(1.0 - rho**2) * noise
    return x


def sample_ddpm(v: Velocity, start: Tensor, _steps: int, generator: torch.Generator) -> Tensor:
    """Return samples of `sample_ancestral` in the 1000 steps of the original."""
    return sample_ancestral(v, start, DDPM_STEPS, generator)


def sample_dpm_solver(
    v: Velocity, start: Tensor, steps: int, _generator: torch.Generator
) -> Tensor:
    """Return samples of x_0 by DPM-Solver++(2M) (Lu et al. 2022, algorithm 2), without noise.

    x_s = sin(s) / sin(t) · x_t + cos(s) · (1 - e^-h) · D, where h is the step in
    lambda = log(cot t), and D extrapolates the predicted x_0 over this step and the last one. The
    first and the last step have no finite h and are of first order.
    """
    x, before, h_before = start, start, inf
    for t, s in pairwise(_list_times(steps)):
        h = _log_cot(s) - _log_cot(t)
        x0 = cos(t) * x - sin(t) * v(x, _each(x, t))
        slope = 0.5 * h / h_before if h < inf and h_before < inf else 0.0
        straight = x0 + slope * (x0 - before)
        left = sin(s) / sin(t)
        x = left * x + (cos(s) - left * cos(t)) * straight
        before, h_before = x0, h
    return x


SAMPLERS: dict[str, Sampler] = {
    "ancestral": sample_ancestral,
    "dpm_solver": sample_dpm_solver,
    "ddpm": sample_ddpm,
}


def _each(x: Tensor, t: float) -> Tensor:
    return torch.full((len(x),), t, dtype=x.dtype, device=x.device)


def _log_cot(t: float) -> float:
    if t <= 0.0:
        return inf
    return -log(tan(t)) if t < pi / 2 else -inf
