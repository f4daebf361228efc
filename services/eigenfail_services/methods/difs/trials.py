"""What DiFS has seen: noise trajectories and their robustness."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from eigenfail.values import EpisodeResult, Floats, Outcome

SOFTNESS = 0.15
"""Scale of the weight's fall above the threshold, in units of the prior's median robustness."""

FLOOR = 0.02
"""What even the safest trajectory weighs: the model keeps knowing what is ordinary."""

SMALLEST_SCALE_M = 1e-3


class Trials:
    """Noise trajectories with their robustness; the safest make room when memory is full.

    Args:
        horizon: steps of a full episode.
        memory: how many trajectories are kept.
    """

    def __init__(self, horizon: int, memory: int) -> None:
        self._memory = memory
        self.z = np.zeros((0, horizon, 2), np.float32)
        self.steps = np.zeros(0, np.int64)
        self.robustness = np.zeros(0, np.float32)

    def __len__(self) -> int:
        return len(self.robustness)

    def add(self, results: Sequence[EpisodeResult]) -> None:
        """Keep the episodes that were run to their end."""
        for result in results:
            if result.outcome is not Outcome.FAILED and result.measures is not None:
                self._append(result.noise.z, result.measures.robustness_m)
        if len(self) > self._memory:
            kept = np.sort(np.argsort(self.robustness, kind="stable")[: self._memory])
            self.z, self.steps, self.robustness = (
                self.z[kept],
                self.steps[kept],
                self.robustness[kept],
            )

    def quantile(self, share: float) -> float:
        """The robustness below which that share of the trajectories lies; inf without any. [m]"""
        return float(np.quantile(self.robustness, share)) if len(self) else float("inf")

    def weights(self, threshold_m: float, scale_m: float) -> NDArray[np.float64]:
        """How much each trajectory counts in training: all of them, the safer the less."""
        beyond = np.maximum(self.robustness.astype(np.float64) - threshold_m, 0.0)
        return np.exp(-beyond / (SOFTNESS * scale_m)) + FLOOR

    def unseen(self) -> NDArray[np.bool_]:
        """Which steps lie behind an episode's end, shape (n, horizon, 1).

        No noise was injected there, and none would have mattered: given a failure they are
        distributed as the prior, and training fills them with fresh draws from it. Zeros would
        teach the model to be too narrow there.
        """
        return (np.arange(self.z.shape[1]) >= self.steps[:, None])[..., None]

    def _append(self, z: Floats, robustness_m: float) -> None:
        padded = np.zeros((1, *self.z.shape[1:]), np.float32)
        padded[0, : len(z)] = z
        self.z = np.concatenate([self.z, padded])
        self.steps = np.append(self.steps, len(z))
        self.robustness = np.append(self.robustness, np.float32(robustness_m))
