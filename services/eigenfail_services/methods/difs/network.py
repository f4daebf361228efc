"""Denoiser of the diffusion model: a convolutional network over the steps of a trajectory."""

from math import ceil

import torch
from torch import Tensor, nn
from torch.nn import functional

MOST_POSITIONS = 33
"""Number of positions of the convolutions: longer trajectories have several steps in each, so that
training takes as long for a long episode as for a short one."""

DILATIONS = (1, 4)
"""Distances of the neighbours that the blocks see, in positions."""

FEATURES = 7
"""Four features of the diffusion time, three of the condition."""


def compute_features(angle: Tensor, condition: Tensor) -> Tensor:
    """Return features of the diffusion time t and the condition r, shape (n, FEATURES).

    The exponentials set failures, r = 0, apart from near failures.
    """
    turns = [torch.sin(angle), torch.cos(angle), torch.sin(2 * angle), torch.cos(4 * angle)]
    levels = [condition, torch.exp(-4.0 * condition), torch.exp(-16.0 * condition)]
    return torch.stack(turns + levels, dim=1)


class ResidualBlock(nn.Module):
    """Convolution over three positions, scaled and shifted by the features (Perez et al. 2018).

    Scale and shift also depend on the mean over all positions, by which each position sees the
    whole trajectory. The scale is bounded: otherwise the product of two hidden values would grow
    without limit where no training data lie, and samples with it. The convolution is a matrix
    product over shifted copies, which on a CPU takes less time than torch's convolutions with so
    few channels.

    Args:
        width: width of the hidden values.
        dilation: distance of the neighbours. [positions]
        features: number of the features.
    """

    def __init__(self, width: int, dilation: int, features: int = FEATURES) -> None:
        super().__init__()
        self._dilation = dilation
        self.convolution = nn.Linear(3 * width, width)
        self.modulation = nn.Linear(features + width, 2 * width)
        self.projection = nn.Linear(width, width)

    def forward(self, hidden: Tensor, features: Tensor) -> Tensor:
        """Return the next hidden values, shape (n, positions, width) as `hidden`."""
        positions, reach = hidden.shape[1], self._dilation
        padded = functional.pad(hidden, (0, 0, reach, reach))
        seen = [padded[:, :positions], hidden, padded[:, 2 * reach :]]
        # The mean over positions: the convolutions alone see a few neighbours.
        context = torch.cat([features, hidden.mean(dim=1)], dim=1)
        scale, shift = self.modulation(context)[:, None].chunk(2, dim=2)
        local = self.convolution(torch.cat(seen, dim=2)) * (1.0 + torch.tanh(scale)) + shift
        change: Tensor = self.projection(functional.silu(local))
        return hidden + change


class Denoiser(nn.Module):
    """v(x_t, t, r) = -sin(t) · m + trust · correction(x_t, t, r, m), zero before training.

    For a standard normal v is zero, so that the untrained network samples the prior exactly; for a
    normal with mean m, v = -sin(t) · m exactly. The first term is that mean, of the component of
    the mixture for which a sample is drawn. The second term learns what the mixture does not
    explain: widths, pushes at varying times, the dependence on robustness. Its weights are the same
    at all positions, so that a few dozen trajectories suffice. `trust` is the extent to which it
    holds for held-out trajectories.

    Args:
        horizon: number of steps of a trajectory.
        channels: number of channels of the noise.
        width: width of the hidden layers.
    """

    trust: Tensor

    def __init__(self, horizon: int, channels: int, width: int) -> None:
        super().__init__()
        self.register_buffer("trust", torch.zeros(()))
        self._steps = ceil(horizon / MOST_POSITIONS)
        self._positions = ceil(horizon / self._steps)
        self._size = self._steps * channels
        self.first = nn.Linear(2 * self._size, width)
        self.blocks = nn.ModuleList([ResidualBlock(width, dilation) for dilation in DILATIONS])
        self.last = nn.Linear(width, self._size)
        for parameter in self.last.parameters():
            nn.init.zeros_(parameter)

    def forward(self, x: Tensor, angle: Tensor, condition: Tensor, mean: Tensor) -> Tensor:
        """Return v, x and mean of shape (n, size), for angle and condition of shape (n,)."""
        corrected = self.correct(x, angle, condition, mean)
        return self.trust * corrected - torch.sin(angle)[:, None] * mean

    def correct(self, x: Tensor, angle: Tensor, condition: Tensor, mean: Tensor) -> Tensor:
        """Return the correction, shape (n, size); arguments as of `forward`."""
        away = x - torch.cos(angle)[:, None] * mean
        hidden = self.first(torch.cat([self._divide(away), self._divide(mean)], dim=2))
        features = compute_features(angle, condition)
        for block in self.blocks:
            hidden = block(hidden, features)
        correction: Tensor = self.last(functional.silu(hidden))
        return correction.flatten(1)[:, : x.shape[1]]

    def _divide(self, x: Tensor) -> Tensor:
        """Return x by position, shape (n, positions, steps · channels), with zeros at the end."""
        missing = self._positions * self._size - x.shape[1]
        return functional.pad(x, (0, missing)).view(len(x), self._positions, -1)
