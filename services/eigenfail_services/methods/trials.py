"""Noise trajectories of finished episodes: a memory of them, their excess, and their moves."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from eigenfail.values.arrays import Floats
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.learning import Experience
from eigenfail_services.methods.archive import Arrays, take


class TrialMemory:
    """Noise trajectories with their robustness; a full memory drops the safest ones.

    Args:
        horizon: number of steps of a full episode.
        channels: number of channels of the noise.
        memory: number of trajectories.
    """

    def __init__(self, horizon: int, channels: int, memory: int) -> None:
        self._memory = memory
        self.z = np.zeros((0, horizon, channels), np.float32)
        self.steps = np.zeros(0, np.int64)
        self.robustness = np.zeros(0, np.float32)

    def __len__(self) -> int:
        return len(self.robustness)

    def add(self, results: Sequence[EpisodeResult]) -> None:
        """Add completed episodes."""
        for result in results:
            # Without measures there is no robustness to sort by.
            if result.outcome is not Outcome.ERRORED and result.measures is not None:
                steps = len(result.noise.z)
                padded = np.zeros((1, *self.z.shape[1:]), np.float32)
                padded[0, :steps] = result.noise.z
                self._append(padded, np.array([steps]), np.array([result.measures.robustness_m]))
        self._forget()

    def add_experience(self, experience: Experience) -> None:
        """Add episodes of earlier campaigns."""
        self._append(experience.z, experience.steps, experience.robustness_m)
        self._forget()

    def arrays(self) -> Arrays:
        """Return the trajectories, their lengths and their robustness."""
        return {"z": self.z, "steps": self.steps, "robustness": self.robustness}

    def load(self, arrays: Arrays) -> None:
        """Restore the trajectories.

        Raises:
            ValueError: an array is missing or has another shape.
        """
        robustness = arrays["robustness"]
        z = take(arrays, "z", (len(robustness), *self.z.shape[1:]))
        self.steps = take(arrays, "steps", (len(robustness),))
        self.z, self.robustness = z, robustness

    def quantile(self, share: float) -> float:
        """Return a quantile of the robustness; inf without trajectories. [m]"""
        return float(np.quantile(self.robustness, share)) if len(self) else float("inf")

    def find_unseen(self) -> NDArray[np.bool_]:
        """Return which steps lie behind an episode's end, shape (n, horizon).

        No noise was injected there, and none would have mattered: given a failure, it has the
        prior's distribution, and training fills it with new draws. Zeros would make the model too
        narrow there.
        """
        return np.arange(self.z.shape[1]) >= self.steps[:, None]

    def _append(self, z: Floats, steps: NDArray[np.number], robustness: Floats) -> None:
        self.z = np.concatenate([self.z, z.astype(np.float32)])
        self.steps = np.concatenate([self.steps, steps.astype(np.int64)])
        self.robustness = np.concatenate([self.robustness, robustness.astype(np.float32)])

    def _forget(self) -> None:
        if len(self) > self._memory:
            # `lexsort` sorts by its last key first: by robustness, and among equals the newest.
            newest_first = -np.arange(len(self))
            kept = np.sort(np.lexsort((newest_first, self.robustness))[: self._memory])
            self.z, self.steps = self.z[kept], self.steps[kept]
            self.robustness = self.robustness[kept]


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


def move(z: Floats, random: np.random.Generator) -> Floats:
    """Shift each trajectory in time, and give each of its channels a random sign.

    A shift is drawn uniformly from all shifts that keep at least one step. Steps without shifted
    noise get new draws. Noise from p(x) stays noise from p(x).

    Args:
        z: shape (n, horizon, channels). [sigma]
        random: generator of shifts, signs and new draws.
    """
    count, horizon, channels = z.shape
    by = random.integers(1 - horizon, horizon, size=(count, 1))
    source = np.arange(horizon) - by
    inside = (source >= 0) & (source < horizon)
    shifted = np.take_along_axis(z, np.clip(source, 0, horizon - 1)[..., None], axis=1)
    fresh = random.standard_normal(z.shape, np.float32)
    signs = random.choice(np.array([-1.0, 1.0], np.float32), size=(count, 1, channels))
    moved: Floats = np.where(inside[..., None], shifted, fresh) * signs
    return moved
