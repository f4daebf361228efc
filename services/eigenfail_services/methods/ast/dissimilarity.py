"""A reward against mode collapse: failures pay more, the less they resemble earlier ones."""

from collections.abc import Sequence

import msgspec
import numpy as np

from eigenfail.values import EpisodeResult, Floats
from eigenfail_services.methods.archive import Arrays
from eigenfail_services.methods.ast.reward import PaperReward, Rewards

KEPT = 100
"""Failures that are compared with, the newest: older ones stem from policies long left behind."""


class DissimilarityReward(msgspec.Struct, frozen=True, eq=False):
    """Corso et al. 2019 (AST with Reward Augmentation, IEEE ITSC): trajectory dissimilarity.

    A terminal failure earns c_dissimilarity · d instead of 0. d is the distance from the nearest
    of the failures known: the root mean square over steps and axes of the difference in z, which
    is zero behind an episode's end [sigma]. The first failure has nothing to differ from: d = 0.
    Corso et al. compare trajectories of states; noise needs no simulator to be compared.

    Attributes:
        paper: the reward of all other steps.
        c_dissimilarity: bonus per sigma.
        failures: those known, shape (n, horizon, 2). [sigma]
    """

    paper: PaperReward
    c_dissimilarity: float
    failures: Floats

    def __call__(self, result: EpisodeResult) -> Rewards:
        """The reward of every step, shape (steps,)."""
        rewards = self.paper(result)
        if result.is_failure:
            rewards[-1] += self.c_dissimilarity * self.distance(result)
        return rewards

    def distance(self, result: EpisodeResult) -> float:
        """From the nearest failure known. [sigma]"""
        if not len(self.failures):
            return 0.0
        differences = self.failures - self._whole(result)
        return float(np.sqrt(np.square(differences).mean(axis=(1, 2)).min()))

    def after(self, results: Sequence[EpisodeResult]) -> "DissimilarityReward":
        """With the failures among these episodes, the oldest left out."""
        found = [self._whole(result)[None] for result in results if result.is_failure]
        failures = np.concatenate([self.failures, *found])[-KEPT:]
        return msgspec.structs.replace(self, failures=failures)

    def arrays(self) -> Arrays:
        """The failures known."""
        return {"failures": self.failures}

    def loaded(self, arrays: Arrays) -> "DissimilarityReward":
        """With the failures of these arrays.

        Raises:
            ValueError: they are missing or of another length.
        """
        failures = arrays.get("failures")
        if failures is None or failures.shape[1:] != self.failures.shape[1:]:
            raise ValueError("there are no failures of this horizon")
        return msgspec.structs.replace(self, failures=failures)

    def _whole(self, result: EpisodeResult) -> Floats:
        """z to the horizon, shape (horizon, 2)."""
        z = np.zeros(self.failures.shape[1:], np.float32)
        z[: result.steps] = result.noise.z
        return z
