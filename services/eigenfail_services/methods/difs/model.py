"""The conditional diffusion model with its training state."""

from copy import deepcopy
from itertools import chain
from math import pi

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from eigenfail.errors import InvalidValue, LearnerDiverged
from eigenfail.values import Floats
from eigenfail_services.methods import tensors
from eigenfail_services.methods.archive import Arrays, take
from eigenfail_services.methods.difs import diffusion
from eigenfail_services.methods.difs.batches import Noised, Trajectories, shifted
from eigenfail_services.methods.difs.denoiser import Denoiser
from eigenfail_services.methods.difs.mixture import Mixture, one_normal
from eigenfail_services.methods.difs.modes import elite, fit
from eigenfail_services.methods.difs.options import DiffusionOptions, Examples
from eigenfail_services.methods.difs.samplers import SAMPLERS

JUDGED = 1024
"""How many noised trajectories say how far the correction can be trusted."""


class DiffusionModel:
    """Learns p(x | r) from examples and samples from it.

    Every use takes the number of a draw, on which its randomness depends alone.

    Attributes:
        mixture: what is known in closed form.
    """

    @tensors.within_memory()
    def __init__(self, options: DiffusionOptions) -> None:
        torch.set_num_threads(1)
        self._options = options
        self._device = _device(options.device)
        with tensors.own_randomness(options.seed, 0):
            self._denoiser = Denoiser(options.horizon * 2, options.width).to(self._device)
        self.mixture = one_normal(options.horizon * 2)
        self._average = deepcopy(self._denoiser).requires_grad_(requires_grad=False)
        self._optimizer = _optimizer(self._denoiser, options)

    @tensors.within_memory()
    def train(self, examples: Examples, steps: int, draw: int) -> None:
        """Take gradient steps.

        Raises:
            LearnerDiverged: a weight became NaN or infinite, or the device has no room.
        """
        generator = self._generator(self._random(draw))
        held_out = torch.from_numpy(examples.held_out).to(self._device)
        self.mixture = fit(elite(examples.z, examples.unseen, self._options.jitter), examples.modes)
        given = self._tensors(examples)
        self._correct(given.only(~held_out), steps, generator)
        self._judge(given.only(held_out), generator)
        if not tensors.all_finite(chain(self._average.parameters(), self._average.buffers())):
            raise LearnerDiverged(
                "The diffusion model diverged: a weight became NaN or infinite.",
                "Lower learning_rate and start the campaign anew.",
            )

    @tensors.within_memory()
    def sample(
        self, condition: Floats, guidance: float, draw: int, mixture: Mixture | None = None
    ) -> Floats:
        """Trajectories for conditions (robustness ÷ scale), shape (n, horizon, 2). [sigma]

        The weight w of classifier-free guidance gives (1 + w) · v(r) - w · v(nothing known); the
        latter is that of the prior, and zero. So w below 0 leads back towards the prior.

        Args:
            condition: one for each trajectory, shape (n,).
            guidance: w, at least -1.
            draw: number of the draw.
            mixture: whose samples they are, instead of the model's own.

        Raises:
            LearnerDiverged: the model does not give finite numbers, or the device has no room.
        """
        random, wanted = self._random(draw), self._tensor(condition)
        generator = self._generator(random)
        given = mixture or self.mixture
        means = self._tensor(given.means[given.drawn(len(condition), random)])

        def velocity(x: Tensor, angle: Tensor) -> Tensor:
            guided: Tensor = (1.0 + guidance) * self._average(x, angle, wanted, means)
            return guided

        options = self._options
        start = self._randn((len(condition), options.horizon * 2), generator)
        with torch.no_grad():
            sample = SAMPLERS[options.sampler]
            x = sample(velocity, start, options.sampling_steps, generator)
        return _finite(x.cpu().numpy().reshape(len(condition), options.horizon, 2))

    def arrays(self) -> Arrays:
        """Mixture, weights, their averages and the optimizer's moments."""
        return {
            "shares": self.mixture.shares,
            "means": self.mixture.means,
            **tensors.module_arrays("denoiser", self._denoiser),
            **tensors.module_arrays("average", self._average),
            **tensors.adam_arrays("optimizer", self._optimizer),
        }

    def load(self, arrays: Arrays) -> None:
        """Go on from there.

        Raises:
            ValueError: an array is missing or has another shape.
        """
        shape = (len(arrays["shares"]), self._options.horizon * 2)
        self.mixture = Mixture(arrays["shares"], take(arrays, "means", shape))
        tensors.load_module("denoiser", self._denoiser, arrays)
        tensors.load_module("average", self._average, arrays)
        tensors.load_adam("optimizer", self._optimizer, arrays)

    def _correct(self, given: Trajectories, steps: int, generator: torch.Generator) -> None:
        """Gradient steps of the velocity's mean squared error, and the averages' behind them."""
        averages: list[Tensor] = list(self._average.parameters())
        weights: list[Tensor] = list(self._denoiser.parameters())
        for _ in range(steps if len(given.z) else 0):
            noised = self._noised(given, self._options.batch_size, generator)
            predicted = self._denoiser.correct(noised.x, noised.angle, noised.condition)
            loss = torch.nn.functional.mse_loss(predicted, noised.left)
            self._optimizer.zero_grad()
            torch.autograd.backward(loss)
            self._optimizer.step()
            with torch.no_grad():
                torch._foreach_lerp_(averages, weights, 1.0 - self._options.ema)

    def _judge(self, held_out: Trajectories, generator: torch.Generator) -> None:
        """Trust the correction as far as it explains trajectories that it never saw.

        trust = <left, correction> / <correction, correction>, within 0 and 1: the least squares.
        """
        trust = torch.zeros((), device=self._device)
        if len(held_out.z):
            with torch.no_grad():
                noised = self._noised(held_out, JUDGED, generator)
                correction = self._average.correct(noised.x, noised.angle, noised.condition)
                size = (correction**2).sum().clamp_min(torch.finfo(correction.dtype).tiny)
                trust = ((noised.left * correction).sum() / size).clamp(0.0, 1.0)
        for network in (self._denoiser, self._average):
            network.trust.copy_(trust)

    def _noised(self, given: Trajectories, count: int, generator: torch.Generator) -> Noised:
        """Trajectories drawn, shifted and diffused, and what the mean leaves of their velocity."""
        rows = torch.randint(len(given.z), (count,), generator=generator, device=self._device)
        drawn, most = given.only(rows), self._options.jitter
        size = (count, 1)
        by = torch.randint(-most, most + 1, size, generator=generator, device=self._device)
        z, unseen = shifted(drawn.z, drawn.unseen, by)
        x0 = torch.where(unseen[..., None], self._randn(z.shape, generator), z).flatten(1)
        eps = self._randn(x0.shape, generator)
        angle = torch.rand(count, generator=generator, device=self._device) * (pi / 2)
        left = diffusion.velocity(x0, eps, angle) + torch.sin(angle)[:, None] * drawn.mean
        return Noised(diffusion.diffuse(x0, eps, angle), angle, drawn.condition, left)

    def _tensors(self, examples: Examples) -> Trajectories:
        unseen = torch.from_numpy(examples.unseen).to(self._device)
        each = self.mixture.components(examples.z, examples.unseen)
        condition = self._tensor(examples.condition)
        means = self._tensor(self.mixture.means[each])
        return Trajectories(self._tensor(examples.z), unseen, condition, means)

    def _random(self, draw: int) -> np.random.Generator:
        return np.random.default_rng([self._options.seed, draw])

    def _generator(self, random: np.random.Generator) -> torch.Generator:
        return torch.Generator(self._device).manual_seed(int(random.integers(2**63)))

    def _randn(self, shape: tuple[int, ...], generator: torch.Generator) -> Tensor:
        return torch.randn(shape, generator=generator, device=self._device)

    def _tensor(self, array: NDArray[np.floating]) -> Tensor:
        return torch.from_numpy(np.array(array, np.float32)).to(self._device)


def _finite(samples: NDArray[np.float32]) -> NDArray[np.float32]:
    if not np.isfinite(samples).all():
        raise LearnerDiverged(
            "The diffusion model sampled numbers that are not finite.",
            "Lower learning_rate or guidance and start the campaign anew.",
        )
    return samples


def _optimizer(denoiser: Denoiser, options: DiffusionOptions) -> torch.optim.AdamW:
    return torch.optim.AdamW(
        denoiser.parameters(),
        lr=options.learning_rate,
        weight_decay=options.weight_decay,
        fused=True,
    )


def _device(name: str) -> torch.device:
    available = "cuda" if torch.cuda.is_available() else "cpu"
    if name == "cuda" and available != name:
        raise InvalidValue(
            "settings.device",
            "cuda is asked for, and torch finds no GPU where the learner runs.",
            "Set device to auto or cpu, or run the services with a torch for CUDA on a machine "
            "with a GPU and its driver; then start a campaign like it anew.",
        )
    return torch.device(available if name == "auto" else name)
