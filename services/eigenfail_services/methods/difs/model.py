"""The conditional diffusion model with its training state."""

from copy import deepcopy
from math import pi
from typing import Any

import msgspec
import numpy as np
import torch
from torch import Tensor

from eigenfail.errors import LearnerFailed
from eigenfail.values import Floats
from eigenfail_services.methods import tensors
from eigenfail_services.methods.archive import Arrays
from eigenfail_services.methods.difs import diffusion
from eigenfail_services.methods.difs.denoiser import Denoiser
from eigenfail_services.methods.difs.options import DiffusionOptions, Examples

CORRECTION_PACE = 0.2
"""The correction learns slower than the mean: it would memorise a few hundred trajectories."""


class DiffusionModel:
    """Learns p(x | r) from weighted examples and samples from it.

    Every use takes the number of a draw, on which its randomness depends alone.
    """

    def __init__(self, options: DiffusionOptions) -> None:
        torch.set_num_threads(1)
        self._options = options
        self._device = _device(options.device)
        with tensors.own_randomness(options.seed, 0):
            self._denoiser = Denoiser(options.horizon * 2, options.width).to(self._device)
        self._average = deepcopy(self._denoiser).requires_grad_(requires_grad=False)
        self._optimizer = _optimizer(self._denoiser, options)

    def train(self, examples: Examples, steps: int, draw: int) -> None:
        """Take gradient steps.

        Raises:
            LearnerFailed: a weight became NaN or infinite.
        """
        random = np.random.default_rng([self._options.seed, draw])
        generator = self._generator(random)
        x0, unseen, condition = (
            self._tensor(part) for part in msgspec.structs.astuple(examples)[:3]
        )
        share = examples.weights / examples.weights.sum()
        rows = random.choice(len(share), (steps, self._options.batch_size), p=share)
        for batch in torch.from_numpy(rows).to(self._device):
            self._step(x0[batch], unseen[batch], condition[batch], generator)
        if not tensors.all_finite(self._average.parameters()):
            raise LearnerFailed(
                "The diffusion model diverged: a weight became NaN or infinite.",
                "Lower learning_rate and start the campaign anew.",
            )

    def sample(self, condition: Floats, guidance: float, draw: int) -> Floats:
        """Trajectories for conditions (robustness ÷ scale), shape (n, horizon, 2).

        Args:
            condition: one for each trajectory, shape (n,).
            guidance: weight w of classifier-free guidance: (1 + w) · v(r) - w · v(unknown).
            draw: number of the draw.
        """
        options = self._options
        generator = self._generator(np.random.default_rng([options.seed, draw]))
        wanted = self._tensor(condition)
        known, unknown = torch.ones_like(wanted), torch.zeros_like(wanted)

        def velocity(x: Tensor, angle: Tensor) -> Tensor:
            conditional = self._average(x, angle, wanted, known)
            free = self._average(x, angle, wanted, unknown)
            guided: Tensor = (1.0 + guidance) * conditional - guidance * free
            return options.shrink * guided

        start = self._randn((len(condition), options.horizon * 2), generator)
        with torch.no_grad():
            x = diffusion.sample(velocity, start, options.sampling_steps, generator)
        return x.cpu().numpy().reshape(len(condition), options.horizon, 2)

    def arrays(self) -> Arrays:
        """Weights, their averages and the optimizer's moments."""
        return {
            **tensors.module_arrays("denoiser", self._denoiser),
            **tensors.module_arrays("average", self._average),
            **tensors.adam_arrays("optimizer", self._optimizer),
        }

    def load(self, arrays: Arrays) -> None:
        """Go on from there.

        Raises:
            ValueError: an array is missing or has another shape.
        """
        tensors.load_module("denoiser", self._denoiser, arrays)
        tensors.load_module("average", self._average, arrays)
        tensors.load_adam("optimizer", self._optimizer, arrays)

    def _step(
        self, x0: Tensor, unseen: Tensor, condition: Tensor, generator: torch.Generator
    ) -> None:
        """One gradient step of the velocity's mean squared error, and the averages' step behind."""
        n = len(x0)
        fresh, eps = self._randn(x0.shape, generator), self._randn(x0.shape, generator)
        uniform = torch.rand((2, n), generator=generator, device=self._device)
        angle, known = uniform[0] * (pi / 2), (uniform[1] >= self._options.dropout).float()
        filled = torch.where(unseen > 0, fresh, x0)
        predicted = self._denoiser(diffusion.diffuse(filled, eps, angle), angle, condition, known)
        loss = torch.nn.functional.mse_loss(predicted, diffusion.velocity(filled, eps, angle))
        self._optimizer.zero_grad()
        torch.autograd.backward(loss)
        self._optimizer.step()
        with torch.no_grad():
            torch._foreach_lerp_(
                list(self._average.parameters()),
                list(self._denoiser.parameters()),
                1.0 - self._options.ema,
            )

    def _generator(self, random: np.random.Generator) -> torch.Generator:
        return torch.Generator(self._device).manual_seed(int(random.integers(2**63)))

    def _randn(self, shape: tuple[int, ...], generator: torch.Generator) -> Tensor:
        return torch.randn(shape, generator=generator, device=self._device)

    def _tensor(self, array: Floats) -> Tensor:
        return torch.from_numpy(np.array(array, np.float32)).to(self._device)


def _optimizer(denoiser: Denoiser, options: DiffusionOptions) -> torch.optim.AdamW:
    parts = ((denoiser.shift, 1.0), (denoiser.correction, CORRECTION_PACE))
    groups: list[dict[str, Any]] = [
        {"params": list(part.parameters()), "lr": options.learning_rate * pace}
        for part, pace in parts
    ]
    return torch.optim.AdamW(groups, weight_decay=options.weight_decay, fused=True)


def _device(name: str) -> torch.device:
    available = "cuda" if torch.cuda.is_available() else "cpu"
    return torch.device(available if name == "auto" else name)
