"""Conditional diffusion model with its training state."""

from collections.abc import Callable
from copy import deepcopy
from itertools import chain, pairwise
from math import cos, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from eigenfail.errors import InvalidValue, LearnerDiverged
from eigenfail.values.arrays import Floats
from eigenfail_services.methods import tensors
from eigenfail_services.methods.archive import Arrays, take
from eigenfail_services.methods.difs import modes
from eigenfail_services.methods.difs.network import Denoiser
from eigenfail_services.methods.difs.settings import DifsSettings, Examples


def diffuse(x0: Tensor, eps: Tensor, angle: Tensor) -> Tensor:
    """Return x_t, shape (n, size)."""
    return torch.cos(angle)[:, None] * x0 + torch.sin(angle)[:, None] * eps


def compute_velocity(x0: Tensor, eps: Tensor, angle: Tensor) -> Tensor:
    """Return the target v = cos(t) · eps - sin(t) · x_0 (Salimans and Ho 2022), shape (n, size)."""
    return torch.cos(angle)[:, None] * eps - torch.sin(angle)[:, None] * x0


class Trajectories(NamedTuple):
    """`Examples` as tensors: z of shape (n, horizon, channels), condition of shape (n,).

    `unseen` has the shape (n, horizon). `mean` is that of the trajectory's component of the
    mixture, shape (n, size).
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
        mean: mean of the component, shape (n, size).
        left: velocity minus that of the mixture, shape (n, size).
    """

    x: Tensor
    angle: Tensor
    condition: Tensor
    mean: Tensor
    left: Tensor


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
    rho = cos(t) / cos(s): the posterior mean for the x_0 that v predicts, and the variance that is
    exact for data of unit variance (Ho et al. 2020, sec. 3.2). So any normal of unit variance is
    sampled exactly in any number of steps, and directions in which v is zero keep the prior.

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


TRUST_SAMPLES = 1024
"""Number of noised trajectories from which the trust in the correction is estimated."""


def weigh_elite(elite: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the chance of each trajectory in training, the elite together as much as the others.

    The others show how noise depends on robustness; by their number, they would displace the
    likely failures of the elite.
    """
    count, most = len(elite), np.count_nonzero(elite)
    if most == count:
        return np.full(count, 1.0 / count)
    return np.where(elite, 0.5 / most, 0.5 / (count - most))


class DiffusionModel:
    """Learns p(x | r) from examples, and samples from it.

    The randomness of each call depends only on the seed and the number of a draw.

    Attributes:
        mixture: part of the model in closed form.
    """

    @tensors.wrap_memory_errors()
    def __init__(self, settings: DifsSettings, horizon: int, channels: int, seed: int) -> None:
        # Several learners share a machine, and sums over threads would depend on their number.
        torch.set_num_threads(1)
        self._settings = settings
        self._shape = horizon, channels
        self._jitter = settings.choose_jitter(horizon)
        self._seed = seed
        self._device = choose_device(settings.device)
        with tensors.isolate_randomness(seed, 0):
            # On the CPU and then moved, so that the first weights are the same on every device.
            denoiser = Denoiser(horizon, channels, settings.width)
            self._denoiser = denoiser.to(self._device)
        self.mixture = modes.make_prior_mixture(horizon * channels)
        self._average = deepcopy(self._denoiser).requires_grad_(requires_grad=False)
        self._optimizer = torch.optim.AdamW(
            self._denoiser.parameters(),
            lr=settings.learning_rate,
            weight_decay=settings.weight_decay,
            fused=True,
        )

    @property
    def trained(self) -> bool:
        """Whether the network has taken gradient steps."""
        return bool(self._optimizer.state)

    @tensors.wrap_memory_errors()
    def train(self, examples: Examples, steps: int, draw: int) -> None:
        """Take gradient steps.

        Raises:
            LearnerDiverged: a weight became NaN or infinite, or the device is out of memory.
        """
        generator = self._make_generator(self._make_random(draw))
        held_out = torch.from_numpy(examples.held_out).to(self._device)
        z, unseen = examples.z[examples.elite], examples.unseen[examples.elite]
        elite = modes.prepare_elite(z, unseen, self._jitter)
        self.mixture = modes.fit_mixture(elite, examples.modes)
        given = self._make_tensors(examples)
        chances = self._make_tensor(weigh_elite(examples.elite))
        self._train_correction(given.select(~held_out), chances[~held_out], steps, generator)
        self._estimate_trust(given.select(held_out), chances[held_out], generator)
        if not tensors.all_finite(chain(self._average.parameters(), self._average.buffers())):
            raise LearnerDiverged(
                "The diffusion model diverged: a weight became NaN or infinite.",
                "Lower learning_rate and launch the campaign again.",
            )

    @tensors.wrap_memory_errors()
    def sample(
        self, condition: Floats, guidance: float, draw: int, mixture: modes.Mixture | None = None
    ) -> Floats:
        """Return trajectories for conditions (robustness ÷ scale). [sigma]

        Their shape is (n, horizon, channels).

        Classifier-free guidance of weight w gives (1 + w) · v(r) - w · v(no condition); the latter
        is that of the prior, and zero. So w below 0 leads towards the prior.

        Args:
            condition: condition r of each trajectory, shape (n,).
            guidance: w, at least -1.
            draw: number of the draw.
            mixture: mixture in place of the model's own.

        Raises:
            LearnerDiverged: a sample is NaN or infinite, or the device is out of memory.
        """
        random, wanted = self._make_random(draw), self._make_tensor(condition)
        generator = self._make_generator(random)
        given = mixture or self.mixture
        means = self._make_tensor(given.means[given.draw_components(len(condition), random)])

        def velocity(x: Tensor, angle: Tensor) -> Tensor:
            guided: Tensor = (1.0 + guidance) * self._average(x, angle, wanted, means)
            return guided

        shape = len(condition), *self._shape
        start = self._randn(shape, generator).flatten(1)
        with torch.no_grad():
            x = sample_ancestral(velocity, start, self._settings.sampling_steps, generator)
        samples: Floats = x.cpu().numpy().reshape(shape)
        if not np.isfinite(samples).all():
            raise LearnerDiverged(
                "The diffusion model sampled numbers that are not finite.",
                "Lower learning_rate or guidance and launch the campaign again.",
            )
        return samples

    def arrays(self) -> Arrays:
        """Return mixture, weights, their averages and the optimizer's moments."""
        return {
            "shares": self.mixture.shares,
            "means": self.mixture.means,
            **tensors.module_arrays("denoiser", self._denoiser),
            **tensors.module_arrays("average", self._average),
            **tensors.adam_arrays("optimizer", self._optimizer),
        }

    def load(self, arrays: Arrays) -> None:
        """Restore the state.

        Raises:
            ValueError: an array is missing or has another shape.
        """
        shape = (len(arrays["shares"]), self.mixture.means.shape[1])
        self.mixture = modes.Mixture(arrays["shares"], take(arrays, "means", shape))
        tensors.load_module("denoiser", self._denoiser, arrays)
        tensors.load_module("average", self._average, arrays)
        tensors.load_adam("optimizer", self._optimizer, arrays)

    def _train_correction(
        self, given: Trajectories, chances: Tensor, steps: int, generator: torch.Generator
    ) -> None:
        """Take gradient steps on the mean squared error, and average the weights."""
        averages: list[Tensor] = list(self._average.parameters())
        weights: list[Tensor] = list(self._denoiser.parameters())
        for _ in range(steps if len(given.z) else 0):
            noised = self._add_noise(given, chances, self._settings.batch_size, generator)
            predicted = self._correct(self._denoiser, noised)
            # What the mixture explains is taken off: the network starts at the answer for a normal.
            loss = torch.nn.functional.mse_loss(predicted, noised.left)
            self._optimizer.zero_grad()
            torch.autograd.backward(loss)
            self._optimizer.step()
            with torch.no_grad():
                # One call for all weights, which are many small tensors.
                torch._foreach_lerp_(averages, weights, 1.0 - self._settings.ema)

    @staticmethod
    def _correct(network: Denoiser, noised: NoisedTrajectories) -> Tensor:
        return network.correct(noised.x, noised.angle, noised.condition, noised.mean)

    def _estimate_trust(
        self, held_out: Trajectories, chances: Tensor, generator: torch.Generator
    ) -> None:
        """Set the trust in the correction by least squares on held-out trajectories.

        trust = <left, correction> / <correction, correction>, within 0 and 1.
        """
        trust = torch.zeros((), device=self._device)
        if len(held_out.z):
            with torch.no_grad():
                noised = self._add_noise(held_out, chances, TRUST_SAMPLES, generator)
                correction = self._correct(self._average, noised)
                # An untrained correction is 0 everywhere: the trust is then 0, not NaN.
                size = (correction**2).sum().clamp_min(torch.finfo(correction.dtype).tiny)
                trust = ((noised.left * correction).sum() / size).clamp(0.0, 1.0)
        for network in (self._denoiser, self._average):
            network.trust.copy_(trust)

    def _add_noise(
        self, given: Trajectories, chances: Tensor, count: int, generator: torch.Generator
    ) -> NoisedTrajectories:
        """Draw, shift and diffuse trajectories; compute the velocity that the mean leaves."""
        rows = torch.multinomial(chances, count, replacement=True, generator=generator)
        drawn, most = given.select(rows), self._jitter
        size = (count, 1)
        by = torch.randint(-most, most + 1, size, generator=generator, device=self._device)
        z, unseen = shift_in_time(drawn.z, drawn.unseen, by)
        # Steps behind an episode's end get new draws each time (see `TrialMemory.find_unseen`).
        x0 = torch.where(unseen[..., None], self._randn(z.shape, generator), z).flatten(1)
        eps = self._randn(x0.shape, generator)
        angle = torch.rand(count, generator=generator, device=self._device) * (pi / 2)
        left = compute_velocity(x0, eps, angle) + torch.sin(angle)[:, None] * drawn.mean
        return NoisedTrajectories(diffuse(x0, eps, angle), angle, drawn.condition, drawn.mean, left)

    def _make_tensors(self, examples: Examples) -> Trajectories:
        unseen = torch.from_numpy(examples.unseen).to(self._device)
        each = self.mixture.assign(examples.z, examples.unseen)
        condition = self._make_tensor(examples.condition)
        means = self._make_tensor(self.mixture.means[each])
        return Trajectories(self._make_tensor(examples.z), unseen, condition, means)

    def _make_random(self, draw: int) -> np.random.Generator:
        return np.random.default_rng([self._seed, draw])

    def _make_generator(self, random: np.random.Generator) -> torch.Generator:
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
