"""Markov chains through the noise whose robustness is at or below a threshold.

Moves are preconditioned Crank–Nicolson's: z' = sqrt(1 − s²)·z + s·xi leaves the standard normal as
it is (Cotter et al. 2013, Statistical Science 28, 424–446), so that a move is accepted wherever it
stays on the level. The step s follows the acceptance (Papaioannou et al. 2015, Probabilistic
Engineering Mechanics 41, 89–103).
"""

from collections.abc import Callable
from math import ceil, exp, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import InvalidValue

Array = NDArray[np.float64]
Robustness = Callable[[Array], Array]
"""Robustness of a batch of noise z, shape (n, steps, 2): n finite numbers."""

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


class ConditionalSampler:
    """Draws `samples` of z on each level, as chains from a share of them.

    Args:
        robustness: see `Robustness`.
        rng: where every draw comes from.
        acceptance: share of the moves to be accepted, by the choice of the step.
    """

    def __init__(self, robustness: Robustness, rng: np.random.Generator, acceptance: float) -> None:
        self._robustness = robustness
        self._rng = rng
        self._acceptance = acceptance
        self._step = FIRST_STEP
        self.evaluations = 0

    def independent(self, samples: int, steps: int) -> Chains:
        """Independent draws: chains of length 1."""
        z = self._rng.standard_normal((samples, steps, 2))
        return Chains(z[None], self._evaluate(z)[None], np.arange(samples), acceptance=1.0)

    def below(self, threshold: float, above: Chains, most: int) -> Chains:
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
            stay_z, stay_value, share = self._move(z[-1], values[-1], threshold)
            z.append(stay_z)
            values.append(stay_value)
            accepted.append(share)
            self._adapt(share, move)
        ancestors = above.ancestors[seeds % len(above.ancestors)]
        return Chains(np.stack(z), np.stack(values), ancestors, float(np.mean(accepted)))

    def _move(self, z: Array, values: Array, threshold: float) -> tuple[Array, Array, float]:
        """Each chain moves, or stays where it would leave the level."""
        kept = sqrt(1.0 - self._step**2)
        proposed = kept * z + self._step * self._rng.standard_normal(z.shape)
        found = self._evaluate(proposed)
        accept = found <= threshold
        moved = np.where(accept[:, None, None], proposed, z)
        return moved, np.where(accept, found, values), float(accept.mean())

    def _adapt(self, accepted: float, move: int) -> None:
        """Larger steps while too many moves are accepted, smaller ones while too few."""
        change = exp((accepted - self._acceptance) / sqrt(move))
        self._step = min(max(self._step * change, SMALLEST_STEP), 1.0)

    def _evaluate(self, z: Array) -> Array:
        values = np.asarray(self._robustness(z), np.float64)
        if values.shape != z.shape[:1] or not np.isfinite(values).all():
            raise InvalidValue(
                "robustness",
                f"{len(z)} trajectories gave values of shape {values.shape}, or not finite ones.",
                "Return one finite number for each trajectory.",
            )
        self.evaluations += len(z)
        return values
