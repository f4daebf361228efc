"""Markov chains through the noise whose robustness is at or below a threshold.

Moves are preconditioned Crank–Nicolson's: z' = sqrt(1 − s²)·z + s·xi leaves the standard normal as
it is (Cotter et al. 2013, Statistical Science 28, 424–446), so that a move is accepted wherever it
stays on the level. The step s follows the acceptance (Papaioannou et al. 2015, Probabilistic
Engineering Mechanics 41, 89–103).
"""

from collections.abc import Generator
from math import ceil, exp, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FIRST_STEP = 0.6
SMALLEST_STEP = 0.001


class Chains(NamedTuple):
    """Samples of one level: chains side by side, each from one seed of the level before.

    Attributes:
        z: shape (length, chains, steps, 2).
        values: their robustness, shape (length, chains).
        ancestors: which independent first draw each chain descends from, shape (chains,).
        acceptance: share of the moves that were accepted; 1 if they were drawn independently.
    """

    z: Array
    values: Array
    ancestors: NDArray[np.intp]
    acceptance: float


Sampling = Generator[Array, Array, Chains]
"""Yields noise z, shape (n, steps, 2); is sent its robustness, shape (n,); returns a level.

Where z could not be run its robustness is NaN. What is sampled then is the noise that can be run:
draws are made anew, and a chain whose move could not be run stays where it is.
"""


class ConditionalSampler:
    """Draws `samples` of z on each level, as chains from a share of them.

    Args:
        rng: where every draw comes from.
        acceptance: share of the moves to be accepted, by the choice of the step.

    Attributes:
        evaluations: how many z were run.
    """

    def __init__(self, rng: np.random.Generator, acceptance: float) -> None:
        self._rng = rng
        self._acceptance = acceptance
        self._step = FIRST_STEP
        self.evaluations = 0

    def independent(self, samples: int, steps: int) -> Sampling:
        """Independent draws: chains of length 1."""
        z, values = np.empty((0, steps, 2)), np.empty(0)
        while missing := samples - len(z):
            drawn = self._rng.standard_normal((missing, steps, 2))
            found = yield drawn
            ran = self._ran(found)
            z, values = np.concatenate([z, drawn[ran]]), np.concatenate([values, found[ran]])
        return Chains(z[None], values[None], np.arange(samples), acceptance=1.0)

    def below(self, threshold: float, above: Chains, most: int) -> Sampling:
        """As many samples as before, at or below a threshold that some of those before reach.

        Seeds are at most `most` of these, drawn without regard to their robustness: where ties let
        more of them through, any of them is as good.
        """
        samples = above.values.size
        reached = np.flatnonzero(above.values <= threshold)
        seeds = self._rng.permutation(reached)[:most]
        z = [above.z.reshape(samples, *above.z.shape[2:])[seeds]]
        values = [above.values.ravel()[seeds]]
        accepted = []
        for move in range(1, ceil(samples / len(seeds))):
            proposed = self._proposed(z[-1])
            found = yield proposed
            share = self._accepted(found, threshold)
            accept = found <= threshold
            z.append(np.where(accept[:, None, None], proposed, z[-1]))
            values.append(np.where(accept, found, values[-1]))
            accepted.append(share)
            self._adapt(share, move)
        ancestors = above.ancestors[seeds % len(above.ancestors)]
        return Chains(np.stack(z), np.stack(values), ancestors, float(np.mean(accepted)))

    def _proposed(self, z: Array) -> Array:
        """Where each chain would go."""
        kept: Array = sqrt(1.0 - self._step**2) * z
        return kept + self._step * self._rng.standard_normal(z.shape)

    def _accepted(self, found: Array, threshold: float) -> float:
        """Share of the moves that stay on the level; of none, the share that is wanted."""
        ran = self._ran(found)
        return float((found[ran] <= threshold).mean()) if ran.any() else self._acceptance

    def _adapt(self, accepted: float, move: int) -> None:
        """Larger steps while too many moves are accepted, smaller ones while too few."""
        change = exp((accepted - self._acceptance) / sqrt(move))
        self._step = min(max(self._step * change, SMALLEST_STEP), 1.0)

    def _ran(self, found: Array) -> NDArray[np.bool_]:
        ran = ~np.isnan(found)
        self.evaluations += int(ran.sum())
        return ran
