"""The conditional diffusion network with its training state."""

from copy import deepcopy
from math import ceil, pi, sqrt
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from eigenfail.errors import LearnerDiverged
from eigenfail.values.arrays import Floats
from eigenfail_searches.diffusion.settings import DiffusionSettings, LabelledNoise
from eigenfail_services.methods import tensors
from eigenfail_services.methods.archive import Arrays
from eigenfail_services.methods.difs.model import (
    choose_device,
    compute_velocity,
    diffuse,
    sample_ancestral,
    shift_in_time,
)
from eigenfail_services.methods.difs.network import ResidualBlock

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


def compute_turns(angle: Tensor) -> Tensor:
    """Return features of the diffusion time t, shape (n, 4)."""
    turns = [torch.sin(angle), torch.cos(angle), torch.sin(2 * angle), torch.cos(4 * angle)]
    return torch.stack(turns, dim=1)


def compute_levels(condition: Tensor, excess: Tensor) -> Tensor:
    """Return features of the robustness and the excess, shape (n, LEVELS).

    The exponentials set failures, robustness 0, apart from near failures.
    """
    levels = [condition, torch.exp(-4.0 * condition), torch.exp(-16.0 * condition)]
    # An excess of 3 is rare under p(x), one of 30 is what noise of far failures has.
    sizes = [torch.tanh(excess / 3.0), torch.tanh(excess / 10.0), excess / 30.0]
    return torch.stack(levels + sizes, dim=1)


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
        self.register_buffer("places", torch.stack(waves, dim=1))
        self.first = nn.Linear(self._size + PLACES, width)
        self.blocks = nn.ModuleList([ResidualBlock(width, each, FEATURES) for each in DILATIONS])
        self.last = nn.Linear(width, self._size)
        self.trend = Trend(horizon, channels)
        for parameter in self.last.parameters():
            nn.init.zeros_(parameter)

    def forward(self, x: Tensor, angle: Tensor, condition: Tensor, excess: Tensor) -> Tensor:
        """Return v, shape (n, size) as x, for vectors of shape (n,)."""
        missing = self._positions * self._size - x.shape[1]
        steps = functional.pad(x, (0, missing)).view(len(x), self._positions, self._size)
        hidden = self.first(torch.cat([steps, self.places.expand(len(x), -1, -1)], dim=2))
        levels = compute_levels(condition, excess)
        features = torch.cat([compute_turns(angle), levels], dim=1)
        for block in self.blocks:
            hidden = block(hidden, features)
        local: Tensor = self.last(functional.silu(hidden)).flatten(1)[:, : x.shape[1]]
        mean: Tensor = self.trend(levels)
        return local - torch.sin(angle)[:, None] * mean


class LabelledTensors(NamedTuple):
    """`LabelledNoise` as tensors; z of shape (n, horizon, channels), `unseen` (n, horizon)."""

    z: Tensor
    unseen: Tensor
    condition: Tensor
    excess: Tensor
    weights: Tensor


class ConditionalDiffusion:
    """Learns p(x | robustness, excess) from examples, and samples from it.

    The randomness of each call depends only on the seed and the number of a draw.
    """

    @tensors.wrap_memory_errors()
    def __init__(self, settings: DiffusionSettings, horizon: int, channels: int, seed: int) -> None:
        # Several learners share a machine, and sums over threads would depend on their number.
        torch.set_num_threads(1)
        self._settings = settings
        self._shape = horizon, channels
        self._jitter = settings.choose_jitter(horizon)
        self._seed = seed
        self._device = choose_device(settings.device)
        with tensors.isolate_randomness(seed, 0):
            # On the CPU and then moved, so that the first weights are the same on every device.
            denoiser = ConditionalDenoiser(horizon, channels, settings.width)
            self._denoiser = denoiser.to(self._device)
        self._average = deepcopy(self._denoiser).requires_grad_(requires_grad=False)
        self._optimizer = torch.optim.AdamW(
            self._denoiser.parameters(), lr=settings.learning_rate, weight_decay=1e-5, fused=True
        )

    @property
    def trained(self) -> bool:
        """Whether the network has taken gradient steps."""
        return bool(self._optimizer.state)

    @tensors.wrap_memory_errors()
    def train(self, examples: LabelledNoise, draw: int) -> None:
        """Take gradient steps on batches of half elite, half any trajectories.

        With the elite alone, a network that learns from its own samples drifts away from p(x).

        Raises:
            LearnerDiverged: a weight became NaN or infinite, or the device is out of memory.
        """
        given, generator = self._make_tensors(examples), self._make_generator(draw)
        averages: list[Tensor] = list(self._average.parameters())
        weights: list[Tensor] = list(self._denoiser.parameters())
        for _ in range(self._settings.steps if self.trained else self._settings.first_steps):
            loss = self._compute_loss(given, generator)
            self._optimizer.zero_grad()
            torch.autograd.backward(loss)
            self._optimizer.step()
            with torch.no_grad():
                # One call for all weights, which are many small tensors.
                torch._foreach_lerp_(averages, weights, 1.0 - self._settings.ema)
        if not tensors.all_finite(self._average.parameters()):
            raise LearnerDiverged(
                "The diffusion model diverged: a weight became NaN or infinite.",
                "Lower learning_rate and launch the campaign again.",
            )

    @tensors.wrap_memory_errors()
    def sample(self, condition: Floats, excess: float, draw: int) -> Floats:
        """Return a trajectory for each robustness ÷ scale. [sigma]

        Their shape is (n, horizon, channels).

        Args:
            condition: robustness ÷ scale of each trajectory, shape (n,).
            excess: excess that all of them are asked to have.
            draw: number of the draw.

        Raises:
            LearnerDiverged: a sample is NaN or infinite, or the device is out of memory.
        """
        generator, wanted = self._make_generator(draw), self._make_tensor(condition)
        same = torch.full_like(wanted, excess)

        def velocity(x: Tensor, angle: Tensor) -> Tensor:
            predicted: Tensor = self._average(x, angle, wanted, same)
            return predicted

        shape = len(condition), *self._shape
        start = self._randn(shape, generator).flatten(1)
        with torch.no_grad():
            x = sample_ancestral(velocity, start, self._settings.sampling_steps, generator)
        samples: Floats = x.cpu().numpy().reshape(shape)
        if not np.isfinite(samples).all():
            raise LearnerDiverged(
                "The diffusion model sampled numbers that are not finite.",
                "Lower learning_rate and launch the campaign again.",
            )
        return samples

    def arrays(self) -> Arrays:
        """Return weights, their averages and the optimizer's moments."""
        return {
            **tensors.module_arrays("denoiser", self._denoiser),
            **tensors.module_arrays("average", self._average),
            **tensors.adam_arrays("optimizer", self._optimizer),
        }

    def load(self, arrays: Arrays) -> None:
        """Restore the state.

        Raises:
            ValueError: an array is missing or has another shape.
        """
        tensors.load_module("denoiser", self._denoiser, arrays)
        tensors.load_module("average", self._average, arrays)
        tensors.load_adam("optimizer", self._optimizer, arrays)

    def _compute_loss(self, given: LabelledTensors, generator: torch.Generator) -> Tensor:
        """Draw, shift and diffuse trajectories; return the mean squared error of the velocity."""
        count, most = self._settings.batch_size, self._jitter
        best = torch.multinomial(given.weights, count // 2, replacement=True, generator=generator)
        size = (count - count // 2,)
        others = torch.randint(len(given.z), size, generator=generator, device=self._device)
        rows = torch.cat([best, others])
        by = torch.randint(-most, most + 1, (count, 1), generator=generator, device=self._device)
        z, unseen = shift_in_time(given.z[rows], given.unseen[rows], by)
        # Steps behind an episode's end get new draws each time (see `TrialMemory.find_unseen`).
        x0 = torch.where(unseen[..., None], self._randn(z.shape, generator), z).flatten(1)
        eps = self._randn(x0.shape, generator)
        angle = torch.rand(count, generator=generator, device=self._device) * (pi / 2)
        predicted = self._denoiser(
            diffuse(x0, eps, angle), angle, given.condition[rows], given.excess[rows]
        )
        return functional.mse_loss(predicted, compute_velocity(x0, eps, angle))

    def _make_tensors(self, examples: LabelledNoise) -> LabelledTensors:
        return LabelledTensors(
            self._make_tensor(examples.z),
            torch.from_numpy(examples.unseen).to(self._device),
            self._make_tensor(examples.condition),
            self._make_tensor(examples.excess),
            torch.from_numpy(examples.weights).to(self._device),
        )

    def _make_generator(self, draw: int) -> torch.Generator:
        random = np.random.default_rng([self._seed, draw])
        return torch.Generator(self._device).manual_seed(int(random.integers(2**63)))

    def _randn(self, shape: tuple[int, ...], generator: torch.Generator) -> Tensor:
        return torch.randn(shape, generator=generator, device=self._device)

    def _make_tensor(self, array: NDArray[np.floating]) -> Tensor:
        return torch.from_numpy(np.array(array, np.float32)).to(self._device)
