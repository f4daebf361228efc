"""The conditional diffusion model of `difs` with its training state."""

from collections.abc import Callable
from copy import deepcopy
from itertools import pairwise
from math import cos, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from eigenfail.errors import InvalidValue, LearnerDiverged
from eigenfail.values.arrays import Floats
from eigenfail_services.methods import tensors
from eigenfail_services.methods.archive import Arrays
from eigenfail_services.methods.difs.network import ConditionalDenoiser
from eigenfail_services.methods.difs.settings import DifsSettings, LabelledNoise


def diffuse(x0: Tensor, eps: Tensor, angle: Tensor) -> Tensor:
    """Return x_t, shape (n, size)."""
    return torch.cos(angle)[:, None] * x0 + torch.sin(angle)[:, None] * eps


def compute_velocity(x0: Tensor, eps: Tensor, angle: Tensor) -> Tensor:
    """Return the target v = cos(t) · eps - sin(t) · x_0 (Salimans and Ho 2022), shape (n, size)."""
    return torch.cos(angle)[:, None] * eps - torch.sin(angle)[:, None] * x0


def shift_in_time(z: Tensor, unseen: Tensor, by: Tensor) -> tuple[Tensor, Tensor]:
    """Shift each trajectory in time; steps that move in from outside are unseen.

    Args:
        z: shape (n, horizon, channels).
        unseen: shape (n, horizon).
        by: number of steps, negative for earlier, shape (n, 1).
    """
    source = torch.arange(unseen.shape[1], device=z.device) - by.long()
    inside = source.clamp(0, unseen.shape[1] - 1)
    moved = torch.gather(z, 1, inside[..., None].expand_as(z))
    return moved, torch.gather(unseen, 1, inside) | (source != inside)


Velocity = Callable[[Tensor, Tensor], Tensor]
"""v(x, t) for x of shape (n, size) and t of shape (n,)."""


def sample_ancestral(v: Velocity, start: Tensor, steps: int, generator: torch.Generator) -> Tensor:
    """Return samples of x_0, by `steps` ancestral steps of DDPM with the wide variance.

    From t to s: x_s ~ N(rho · x_t - cos(s) · (1 - rho²) / sin(t) · v, 1 - rho²) with
    rho = cos(t) / cos(s). The mean is the posterior mean for the x_0 that v predicts. The variance
    is exact for data of unit variance (Ho et al. 2020, sec. 3.2). So any normal of unit variance is
    sampled exactly in any number of steps. Directions in which v is zero keep the prior.

    Args:
        v: predicts the velocity.
        start: standard normal draws, shape (n, size).
        steps: number of steps.
        generator: generator of the noise.
    """
    x = start
    times: list[float] = np.linspace(pi / 2, 0.0, steps + 1).tolist()
    for t, s in pairwise(times):
        # At pi/2 there is no signal yet; the quotient is 0 there but for rounding.
        rho = cos(t) / cos(s) if t < pi / 2 else 0.0
        pull = cos(s) * (1.0 - rho**2) / sin(t)
        noise = torch.randn(x.shape, generator=generator, dtype=x.dtype, device=x.device)
        now = torch.full((len(x),), t, dtype=x.dtype, device=x.device)
        x = rho * x - pull * v(x, now) + sqrt(1.0 - rho**2) * noise
    return x


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
    def __init__(self, settings: DifsSettings, horizon: int, channels: int, seed: int) -> None:
        # Several learners share a machine, and sums over threads would depend on their number.
        torch.set_num_threads(1)
        # Otherwise convolutions on a GPU are rounded, and not the same each time.
        torch.backends.cudnn.set_flags(_deterministic=True, _allow_tf32=False)  # type: ignore[no-untyped-call]
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
    def train(self, examples: LabelledNoise, steps: int, elite_share: float, draw: int) -> None:
        """Take gradient steps on batches of elite and any trajectories.

        With the elite alone, a network that learns from its own samples drifts away from p(x).

        Args:
            examples: training data.
            steps: number of gradient steps.
            elite_share: share of a batch that is drawn from the elite.
            draw: number of the draw.

        Raises:
            LearnerDiverged: a weight became NaN or infinite, or the device is out of memory.
        """
        given, generator = self._make_tensors(examples), self._make_generator(draw)
        averages: list[Tensor] = list(self._average.parameters())
        weights: list[Tensor] = list(self._denoiser.parameters())
        for _ in range(steps):
            loss = self._compute_loss(given, elite_share, generator)
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

    def _compute_loss(
        self, given: LabelledTensors, elite_share: float, generator: torch.Generator
    ) -> Tensor:
        """Draw, shift and diffuse trajectories; return the mean squared error of the velocity."""
        count, most = self._settings.batch_size, self._jitter
        rows = self._draw_rows(given, round(elite_share * count), generator)
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

    def _draw_rows(self, given: LabelledTensors, best: int, generator: torch.Generator) -> Tensor:
        """Return the numbers of the trajectories of a batch, `best` of them from the elite."""
        elite = torch.zeros(0, dtype=torch.int64, device=self._device)
        if best:
            elite = torch.multinomial(given.weights, best, replacement=True, generator=generator)
        rest = (self._settings.batch_size - best,)
        others = torch.randint(len(given.z), rest, generator=generator, device=self._device)
        return torch.cat([elite, others])

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


def choose_device(name: str) -> torch.device:
    """Return the device of a name; auto: cuda if available.

    Raises:
        InvalidValue: cuda is asked for, and torch finds no GPU.
    """
    available = "cuda" if torch.cuda.is_available() else "cpu"
    if name == "cuda" and available != name:
        raise InvalidValue(
            "settings.device",
            "cuda is asked for, and torch finds no GPU where the learner runs.",
            "Set device to auto or cpu, or run the services with a torch for CUDA on a machine "
            "with a GPU and its driver; then launch a copy of the campaign.",
        )
    return torch.device(available if name == "auto" else name)
