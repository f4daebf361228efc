"""What DiFS has seen: noise trajectories and their robustness."""

from collections.abc import Sequence
from math import ceil

import numpy as np
from numpy.typing import NDArray

from eigenfail.values import EpisodeResult, Experience, Floats, Outcome


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
                self._append(
                    _padded(result.noise.z, self.z.shape[1])[None],
                    np.array([len(result.noise.z)]),
                    np.array([result.measures.robustness_m]),
                )
        self._forget()

    def recall(self, experience: Experience) -> None:
        """Keep what earlier campaigns saw."""
        self._append(experience.z, experience.steps, experience.robustness_m)
        self._forget()

    def quantile(self, share: float) -> float:
        """The robustness below which that share of the trajectories lies; inf without any. [m]"""
        return float(np.quantile(self.robustness, share)) if len(self) else float("inf")

    def elite(self, count: int, likely_share: float) -> NDArray[np.intp]:
        """The least robust; once failures are more than `count`, the likelier of the newest.

        Which of two failures is likelier is read along their common mean m, by -z·m: that is
        log p - log q for a proposal q = N(m, 1), up to a constant. By log p alone the noise in
        directions that do not matter would decide. The newest come from proposals that have
        lost more of what does not matter.

        Args:
            count: how many there shall be.
            likely_share: what share of the newest failures they are.
        """
        failures = np.flatnonzero(self.robustness <= 0.0)
        if len(failures) <= count:
            return np.argsort(self.robustness, kind="stable")[:count]
        newest = failures[-ceil(count / likely_share) :]
        z = self.z[newest].reshape(len(newest), -1)
        return newest[np.argsort(z @ z.mean(axis=0), kind="stable")[:count]]

    def unseen(self) -> NDArray[np.bool_]:
        """Which steps lie behind an episode's end, shape (n, horizon).

        No noise was injected there, and none would have mattered: given a failure they are
        distributed as the prior, and training fills them with fresh draws from it. Zeros would
        teach the model to be too narrow there.
        """
        return np.arange(self.z.shape[1]) >= self.steps[:, None]

    def _append(self, z: Floats, steps: NDArray[np.number], robustness: Floats) -> None:
        self.z = np.concatenate([self.z, z.astype(np.float32)])
        self.steps = np.concatenate([self.steps, steps.astype(np.int64)])
        self.robustness = np.concatenate([self.robustness, robustness.astype(np.float32)])

    def _forget(self) -> None:
        if len(self) > self._memory:
            newest_first = -np.arange(len(self))
            kept = np.sort(np.lexsort((newest_first, self.robustness))[: self._memory])
            self.z, self.steps = self.z[kept], self.steps[kept]
            self.robustness = self.robustness[kept]


def _padded(z: Floats, horizon: int) -> Floats:
    padded = np.zeros((horizon, 2), np.float32)
    padded[: len(z)] = z
    return padded
