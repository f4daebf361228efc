"""What DiFS has seen: noise trajectories and their robustness."""

from collections.abc import Sequence
from math import ceil

import numpy as np
from numpy.typing import NDArray

from eigenfail.values import EpisodeResult, Experience, Floats, Outcome
from eigenfail_services.methods.difs.mixture import Rows

PATIENCE = 2
"""Elites of failures found elsewhere, after which a kind without one is given up."""


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

    def elite(self, count: int, likely_share: float, kinds: Rows) -> Rows:
        """The best of each kind, of all kinds that are kept alike many.

        Which kind holds more of p(z | failure) a few dozen failures do not tell, and what had found
        more by chance would soon hold all.

        Args:
            count: how many there shall be.
            likely_share: what share of a kind's newest failures they are.
            kinds: of each trajectory, shape (n,).
        """
        kept = self._kept(count, kinds)
        each = ceil(count / len(kept))
        return np.concatenate([self._best(rows, each, likely_share) for rows in kept])

    def behind(self, kinds: Rows) -> Floats:
        """How far the best of each trajectory's kind is from the best of all, shape (n,). [m]

        Less this, what is best in a kind is what is asked for at the lowest robustness of all.
        Otherwise the model would be asked for more than a kind has shown, and leave it.
        """
        best = np.full(kinds.max(initial=0) + 1, np.inf, np.float32)
        np.minimum.at(best, kinds, self.robustness)
        late: Floats = best[kinds] - self.robustness.min()
        return late

    def settled(self, count: int, kinds: Rows) -> bool:
        """Whether failures suffice for an elite of that many, in each kind that is kept."""
        kept = self._kept(count, kinds)
        return all(len(self._failures(rows)) >= count / len(kept) for rows in kept)

    def unseen(self) -> NDArray[np.bool_]:
        """Which steps lie behind an episode's end, shape (n, horizon).

        No noise was injected there, and none would have mattered: given a failure they are
        distributed as the prior, and training fills them with fresh draws from it. Zeros would
        teach the model to be too narrow there.
        """
        return np.arange(self.z.shape[1]) >= self.steps[:, None]

    def _kept(self, count: int, kinds: Rows) -> list[Rows]:
        """The trajectories of each kind; in the end of those that have failed at all."""
        each = [np.flatnonzero(kinds == kind) for kind in np.unique(kinds)]
        if np.count_nonzero(self.robustness <= 0.0) < PATIENCE * count:
            return each
        return [rows for rows in each if len(self._failures(rows))]

    def _failures(self, rows: Rows) -> Rows:
        return rows[self.robustness[rows] <= 0.0]

    def _best(self, rows: Rows, count: int, likely_share: float) -> Rows:
        """The least robust; once failures are more than `count`, the likelier of the newest.

        Which of two failures is likelier is read along their common mean m, by -z·m: that is
        log p - log q for a proposal q = N(m, 1), up to a constant. By log p alone the noise in
        directions that do not matter would decide. The newest come from proposals that have
        lost more of what does not matter.
        """
        failures = self._failures(rows)
        if len(failures) <= count:
            return rows[np.argsort(self.robustness[rows], kind="stable")[:count]]
        newest = failures[-ceil(count / likely_share) :]
        z = self.z[newest].reshape(len(newest), -1)
        return newest[np.argsort(z @ z.mean(axis=0), kind="stable")[:count]]

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
