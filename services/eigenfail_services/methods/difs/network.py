"""The network of `difs`: it predicts how noised trajectories come from noise."""

from math import ceil, pi, sqrt

import torch
from torch import Tensor, nn
from torch.nn import functional

MOST_POSITIONS = 50
"""Number of positions of the convolutions: longer trajectories have several steps in each, so that
training takes as long for a long episode as for a short one."""

DILATIONS = (1, 2, 4, 8)
"""Distances of the neighbours that the blocks see, in positions."""

LEVELS = 6
"""Three features of the robustness, three of the excess."""

FEATURES = 4 + LEVELS
"""Features of the diffusion time, the robustness and the excess."""

WAVES, WIDTH_OF_TREND = 8, 32
"""Number of cosines of the trend in each channel, and width of its hidden layer."""

PLACES = 4
"""Features of the place in time, the same for all trajectories."""


def compute_time_features(angle: Tensor) -> Tensor:
    """Return features of the diffusion time t, shape (n, 4)."""
    turns = [torch.sin(angle), torch.cos(angle), torch.sin(2 * angle), torch.cos(4 * angle)]
    return torch.stack(turns, dim=1)


def compute_condition_features(condition: Tensor, excess: Tensor) -> Tensor:
    """Return features of the robustness and the excess, shape (n, LEVELS).

    The exponentials set failures, robustness 0, apart from near failures.
    """
    levels = [condition, torch.exp(-4.0 * condition), torch.exp(-16.0 * condition)]
    # An excess of 3 is rare under p(x), one of 30 is what noise of far failures has.
    sizes = [torch.tanh(excess / 3.0), torch.tanh(excess / 10.0), excess / 30.0]
    return torch.stack(levels + sizes, dim=1)


class ResidualBlock(nn.Module):
    """Convolution over three positions, scaled and shifted by the features (Perez et al. 2018).

    Scale and shift also depend on the mean over all positions, by which each position sees the
    whole trajectory. The scale is bounded: otherwise the product of two hidden values would grow
    without limit where no training data lie, and samples with it.

    Args:
        width: width of the hidden values.
        dilation: distance of the neighbours. [positions]
    """

    def __init__(self, width: int, dilation: int) -> None:
        super().__init__()
        self.convolution = nn.Conv1d(width, width, 3, padding=dilation, dilation=dilation)
        self.modulation = nn.Linear(FEATURES + width, 2 * width)
        self.projection = nn.Conv1d(width, width, 1)

    def forward(self, hidden: Tensor, features: Tensor) -> Tensor:
        """Return the next hidden values, shape (n, width, positions) as `hidden`."""
        # The mean over positions: the convolutions alone see a few neighbours.
        context = torch.cat([features, hidden.mean(dim=2)], dim=1)
        scale, shift = self.modulation(context)[:, :, None].chunk(2, dim=1)
        local = self.convolution(hidden) * (1.0 + torch.tanh(scale)) + shift
        change: Tensor = self.projection(functional.silu(local))
        return hidden + change


class Trend(nn.Module):
    """A mean m of the noise that varies slowly in time, given robustness and excess.

    It is a sum of cosines in each channel, whose amplitudes a small network computes; zero before
    training. Failures that need a little noise for seconds have such a mean. Convolutions alone
    learn it too slowly to find them.

    Args:
        horizon: number of steps of a trajectory.
        channels: number of channels of the noise.
    """

    waves: Tensor

    def __init__(self, horizon: int, channels: int) -> None:
        super().__init__()
        self._channels = channels
        at = (torch.arange(horizon) + 0.5) / horizon
        cosines = [torch.cos(pi * number * at) for number in range(1, WAVES)]
        waves = [torch.ones(horizon), *(sqrt(2.0) * each for each in cosines)]
        self.register_buffer("waves", torch.stack(waves, dim=1))
        self.first = nn.Linear(LEVELS, WIDTH_OF_TREND)
        self.last = nn.Linear(WIDTH_OF_TREND, WAVES * channels)
        for parameter in self.last.parameters():
            nn.init.zeros_(parameter)

    def forward(self, levels: Tensor) -> Tensor:
        """Return m, shape (n, horizon · channels), for features of shape (n, LEVELS)."""
        amplitudes = self.last(functional.silu(self.first(levels)))
        mean: Tensor = self.waves @ amplitudes.view(len(levels), WAVES, self._channels)
        return mean.flatten(1)


class ConditionalDenoiser(nn.Module):
    """v(x_t, t, robustness, excess) = -sin(t) · m + convolutions over time, zero before training.

    For a standard normal v is zero, so that the untrained network samples the prior exactly. For
    a normal of unit variance with the mean m, which is the trend, v = -sin(t) · m exactly.

    Args:
        horizon: number of steps of a trajectory.
        channels: number of channels of the noise.
        width: width of the hidden layers.
    """

    places: Tensor

    def __init__(self, horizon: int, channels: int, width: int) -> None:
        super().__init__()
        steps = ceil(horizon / MOST_POSITIONS)
        self._positions = ceil(horizon / steps)
        self._size = steps * channels
        at = torch.linspace(0.0, pi, self._positions)
        waves = [torch.sin(at), torch.cos(at), torch.sin(2 * at), torch.cos(2 * at)]
        self.register_buffer("places", torch.stack(waves))
        # As convolutions, too: in a learner's process (`NUMERIC_ENVIRONMENT`) they take two thirds
        # of the time of matrix products.
        self.first = nn.Conv1d(self._size + PLACES, width, 1)
        self.blocks = nn.ModuleList([ResidualBlock(width, each) for each in DILATIONS])
        self.last = nn.Conv1d(width, self._size, 1)
        self.trend = Trend(horizon, channels)
        for parameter in self.last.parameters():
            nn.init.zeros_(parameter)

    def forward(self, x: Tensor, angle: Tensor, condition: Tensor, excess: Tensor) -> Tensor:
        """Return v, shape (n, size) as x, for vectors of shape (n,)."""
        missing = self._positions * self._size - x.shape[1]
        steps = functional.pad(x, (0, missing)).view(len(x), self._positions, self._size).mT
        hidden = self.first(torch.cat([steps, self.places.expand(len(x), -1, -1)], dim=1))
        levels = compute_condition_features(condition, excess)
        features = torch.cat([compute_time_features(angle), levels], dim=1)
        for block in self.blocks:
            hidden = block(hidden, features)
        local: Tensor = self.last(functional.silu(hidden)).mT.flatten(1)[:, : x.shape[1]]
        mean: Tensor = self.trend(levels)
        return local - torch.sin(angle)[:, None] * mean
