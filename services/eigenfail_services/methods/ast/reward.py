"""What the adversary is rewarded for: named objects, so that they can stand side by side."""

from collections.abc import Sequence
from typing import Protocol, Self

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.values import EpisodeResult
from eigenfail_services.methods.archive import Arrays

Rewards = NDArray[np.float64]


class Reward(Protocol):
    """Rewards of an episode that was run to its end."""

    def __call__(self, result: EpisodeResult) -> Rewards:
        """The reward of every step, shape (steps,)."""

    def after(self, results: Sequence[EpisodeResult]) -> "Reward":
        """The reward of later episodes, once these are known."""

    def arrays(self) -> Arrays:
        """What it has learnt of earlier episodes."""

    def loaded(self, arrays: Arrays) -> "Reward":
        """The same reward as it was when it gave these arrays.

        Raises:
            ValueError: an array is missing or has another shape.
        """


class Constant(msgspec.Struct, frozen=True):
    """A reward that does not change with what was found."""

    def after(self, _results: Sequence[EpisodeResult]) -> Self:
        """The same."""
        return self

    def arrays(self) -> Arrays:
        """Nothing."""
        return {}

    def loaded(self, _arrays: Arrays) -> Self:
        """The same."""
        return self


class PaperReward(Constant, frozen=True):
    """The paper's reward (eq. 4; Lee et al. 2020, Adaptive Stress Testing, JAIR 69).

    0 at a terminal failure, -alpha - c_dist · d_min at any other end, log p(a_t) at all other
    steps; d_min is the episode's robustness [m].
    """

    alpha: float
    c_dist: float

    def __call__(self, result: EpisodeResult) -> Rewards:
        """The reward of every step, shape (steps,)."""
        rewards = result.noise.log_probability_per_step.copy()
        rewards[-1] = at_end(result, self.alpha, self.c_dist)
        return rewards


class MahalanobisReward(Constant, frozen=True):
    """Koren et al. 2018 (Adaptive Stress Testing for Autonomous Vehicles, IEEE IV).

    -log(1 + M(a_t)) in place of log p(a_t), M the Mahalanobis distance from the mean: ||z_t||.
    It needs no density, only a covariance, and large disturbances cost little more than medium
    ones. The end is the paper's.
    """

    alpha: float
    c_dist: float

    def __call__(self, result: EpisodeResult) -> Rewards:
        """The reward of every step, shape (steps,)."""
        distances = np.linalg.norm(result.noise.z.astype(np.float64), axis=1)
        rewards: Rewards = -np.log1p(distances)
        rewards[-1] = at_end(result, self.alpha, self.c_dist)
        return rewards


def at_end(result: EpisodeResult, alpha: float, c_dist: float) -> float:
    """0 for a failure, otherwise -alpha - c_dist · robustness [m]."""
    if result.is_failure:
        return 0.0
    d_min = result.measures.robustness_m if result.measures else float("nan")
    return -alpha - c_dist * d_min
