"""What the adversary is rewarded for."""

from typing import Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.values import EpisodeResult


class Reward(Protocol):
    """Rewards of an episode that was run to its end."""

    def __call__(self, result: EpisodeResult) -> NDArray[np.float64]:
        """The reward of every step, shape (steps,)."""


class PaperReward(msgspec.Struct, frozen=True):
    """The paper's reward (eq. 4).

    0 at a terminal failure, -alpha - c_dist · d_min at any other end, log p(a_t) at all other
    steps; d_min is the episode's robustness [m].
    """

    alpha: float
    c_dist: float

    def __call__(self, result: EpisodeResult) -> NDArray[np.float64]:
        """The reward of every step, shape (steps,)."""
        rewards = result.noise.log_probability_per_step.copy()
        rewards[-1] = 0.0 if result.is_failure else self._penalty(result)
        return rewards

    def _penalty(self, result: EpisodeResult) -> float:
        d_min = result.measures.robustness_m if result.measures else float("nan")
        return -self.alpha - self.c_dist * d_min
