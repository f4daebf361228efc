"""Settings of `diffusion`, and what its network is trained on."""

from math import ceil
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from eigenfail.values.arrays import Floats
from eigenfail_services.methods import Amount, UpToOne

LARGEST_CONDITION = 10.0
"""Of training: robustness far from failures is all alike, and must not dominate the network."""

STEPS_PER_JITTER = 20
"""Least number of steps of an episode for each step of shift, so that shifts are small."""


class DiffusionSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `diffusion`.

    A larger `excess_quantile` makes failures more frequent and less likely.
    """

    rounds: Annotated[
        int,
        Meta(ge=2, le=1000, description="most rounds of a campaign, each followed by a training"),
    ] = 15
    prior_share: Annotated[
        float,
        Meta(ge=0.0, lt=1.0, description="share of each later round that is drawn from p(x)"),
    ] = 0.2
    moved_share: Annotated[
        float,
        Meta(
            ge=0.0,
            lt=1.0,
            description="share of the network's samples that are shifted in time and mirrored",
        ),
    ] = 0.3
    # The paper of DiFS keeps the lowest 30 %; the reference code (sisl/DiFS) half.
    quantile: Annotated[
        float,
        Meta(gt=0.0, lt=1.0, description="share of a round that sets the threshold"),
    ] = 0.3
    excess_quantile: Annotated[
        float,
        Meta(
            ge=0.0,
            le=1.0,
            description="quantile of the elite's excess that samples are asked for",
        ),
    ] = 0.5
    first_steps: Annotated[
        int, Meta(ge=1, le=1_000_000, description="gradient steps of the first training")
    ] = 400
    steps: Annotated[
        int, Meta(ge=1, le=1_000_000, description="gradient steps of each later training")
    ] = 300
    batch_size: Annotated[
        int, Meta(ge=2, le=100_000, description="trajectories in a gradient step")
    ] = 64
    jitter: Annotated[
        int,
        Meta(ge=0, le=10_000, description="largest shift in training [steps]; at most 1 in 20"),
    ] = 3
    width: Annotated[
        int, Meta(ge=1, le=4096, description="channels of the network's hidden layers")
    ] = 48
    learning_rate: Annotated[UpToOne, Meta(description="learning rate of AdamW")] = 2e-3
    ema: Annotated[float, Meta(ge=0.0, lt=1.0, description="decay of the averaged weights")] = 0.995
    sampling_steps: Annotated[
        int, Meta(ge=1, le=10_000, description="steps in which a trajectory is sampled")
    ] = 30
    memory: Annotated[
        Amount,
        Meta(description="trajectories in memory, and as many moved ones; the safest are dropped"),
    ] = 20_000
    device: Annotated[
        Literal["auto", "cpu", "cuda"],
        Meta(description="device of the network; auto: cuda if available"),
    ] = "auto"

    def choose_jitter(self, horizon: int) -> int:
        """Return the largest shift in training, so small that an episode stays what it is."""
        return min(self.jitter, horizon // STEPS_PER_JITTER)

    def size_round(self, episodes: int) -> int:
        """Return the number of episodes of a round."""
        return ceil(episodes / self.rounds)


class LabelledNoise(msgspec.Struct, frozen=True, eq=False):
    """Training data.

    Attributes:
        z: trajectories, shape (n, horizon, channels). [sigma]
        unseen: whether no noise was injected in a step, shape (n, horizon).
        condition: robustness ÷ scale, within 0 and `LARGEST_CONDITION`, shape (n,).
        excess: excess of the squared noise over p(x), shape (n,); see `compute_excess`.
        weights: chance of each trajectory in the elite half of a batch, shape (n,). It is 0
            outside the elite.
    """

    z: Floats
    unseen: NDArray[np.bool_]
    condition: Floats
    excess: Floats
    weights: NDArray[np.float64]


def compute_excess(z: Floats, unseen: NDArray[np.bool_]) -> Floats:
    """Return (sum z² - d) / sqrt(2 d) over the d injected values of each trajectory, shape (n,).

    Under p(x) it has mean 0 and standard deviation 1: noise with a large excess is unlikely.

    Args:
        z: shape (n, horizon, channels). [sigma]
        unseen: whether no noise was injected in a step, shape (n, horizon).
    """
    numbers = np.maximum((~unseen).sum(axis=1) * z.shape[2], 1).astype(np.float64)
    squares = np.where(unseen[..., None], 0.0, z.astype(np.float64) ** 2).sum(axis=(1, 2))
    excess: Floats = ((squares - numbers) / np.sqrt(2.0 * numbers)).astype(np.float32)
    return excess
