"""Settings of `difs`."""

from typing import Annotated, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.values import Floats


class DiffusionOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Settings of the diffusion model; see `DifsSettings`."""

    horizon: int
    width: int
    learning_rate: float
    weight_decay: float
    batch_size: int
    ema: float
    jitter: int
    sampler: str
    sampling_steps: int
    device: str
    seed: int


class Examples(msgspec.Struct, frozen=True, eq=False):
    """Training data.

    Attributes:
        z: trajectories, shape (n, horizon, 2). [sigma]
        unseen: whether no noise was injected in a step, shape (n, horizon).
        condition: robustness ÷ scale, shape (n,).
        held_out: whether a trajectory only validates the network, shape (n,).
        modes: largest number of components of the mixture.
    """

    z: Floats
    unseen: NDArray[np.bool_]
    condition: Floats
    held_out: NDArray[np.bool_]
    modes: int


Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
Id = Annotated[int, msgspec.Meta(ge=1)]

STEPS_PER_JITTER = 30
"""Least number of steps of an episode for each step of shift, so that shifts are small."""


class DifsSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `difs`.

    `many_rounds` draws little from the prior and then trains after every few episodes, on the
    least robust trajectories of all. `paper` draws 500 from the prior, trains, draws 500 below the
    threshold, trains, and samples the rest at robustness 0.
    """

    schedule: Annotated[
        Literal["many_rounds", "paper"],
        msgspec.Meta(description="how the episodes are divided, and what is trained on"),
    ] = "many_rounds"
    initial_share: Annotated[
        Share | None,
        msgspec.Meta(
            description="share of the episodes drawn from the prior; none: the schedule's"
        ),
    ] = None
    round_size: Annotated[
        Annotated[int, msgspec.Meta(ge=1, le=100_000)] | None,
        msgspec.Meta(description="episodes between two trainings; none: the schedule's"),
    ] = None
    final_share: Annotated[
        Share | None,
        msgspec.Meta(
            description="share sampled at robustness 0 at the end, without training; "
            "none: the schedule's"
        ),
    ] = None
    quantile: Annotated[
        float,
        msgspec.Meta(gt=0.0, lt=1.0, description="share of a round that sets the threshold"),
    ] = 0.3
    elite: Annotated[
        int,
        msgspec.Meta(ge=1, le=100_000, description="trajectories that many_rounds trains on"),
    ] = 20
    likely_share: Annotated[
        float,
        msgspec.Meta(gt=0.0, le=1.0, description="share of the elite in the newest failures"),
    ] = 0.5
    target_rate: Annotated[
        float,
        msgspec.Meta(gt=0.0, lt=1.0, description="target failure rate of the guidance"),
    ] = 0.2
    guidance: Annotated[
        float, msgspec.Meta(ge=-0.9, le=10.0, description="initial weight of the condition")
    ] = 0.15
    final_guidance: Annotated[
        Annotated[float, msgspec.Meta(ge=-0.9, le=10.0)] | None,
        msgspec.Meta(description="weight at robustness 0; none: that of the last round"),
    ] = None
    first_steps: Annotated[
        int, msgspec.Meta(ge=1, le=1_000_000, description="gradient steps of the first training")
    ] = 300
    steps: Annotated[
        int, msgspec.Meta(ge=1, le=1_000_000, description="gradient steps of each later training")
    ] = 100
    jitter: Annotated[
        int,
        msgspec.Meta(
            ge=0, le=10_000, description="largest shift in training [steps]; at most 1 in 30"
        ),
    ] = 3
    width: Annotated[
        int, msgspec.Meta(ge=1, le=4096, description="width of the denoiser's hidden layers")
    ] = 64
    learning_rate: Annotated[
        float, msgspec.Meta(gt=0.0, le=1.0, description="learning rate of AdamW")
    ] = 3e-4
    weight_decay: Annotated[
        float, msgspec.Meta(ge=0.0, le=1.0, description="weight decay of AdamW")
    ] = 1e-5
    batch_size: Annotated[
        int, msgspec.Meta(ge=1, le=100_000, description="trajectories in a gradient step")
    ] = 64
    ema: Annotated[
        float, msgspec.Meta(ge=0.0, lt=1.0, description="decay of the averaged weights")
    ] = 0.995
    sampler: Annotated[
        Literal["ancestral", "dpm_solver", "ddpm"],
        msgspec.Meta(description="sampler of trajectories; ddpm takes 1000 steps"),
    ] = "ancestral"
    sampling_steps: Annotated[
        int, msgspec.Meta(ge=1, le=10_000, description="steps of the other samplers")
    ] = 20
    memory: Annotated[
        int, msgspec.Meta(ge=10, le=1_000_000, description="trajectories in memory")
    ] = 10_000
    device: Annotated[
        Literal["auto", "cpu", "cuda"],
        msgspec.Meta(description="device of the model; auto: cuda if available"),
    ] = "auto"
    data_from: Annotated[
        tuple[Id, ...],
        msgspec.Meta(description="earlier campaigns whose episodes are initial training data"),
    ] = ()

    def options(self, horizon: int, seed: int) -> DiffusionOptions:
        """Return the options of the model."""
        return DiffusionOptions(
            horizon=horizon,
            width=self.width,
            learning_rate=self.learning_rate,
            weight_decay=self.weight_decay,
            batch_size=self.batch_size,
            ema=self.ema,
            jitter=min(self.jitter, horizon // STEPS_PER_JITTER),
            sampler=self.sampler,
            sampling_steps=self.sampling_steps,
            device=self.device,
            seed=seed,
        )
