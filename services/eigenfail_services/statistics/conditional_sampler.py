"""Samples of noise on the levels of a subset simulation: Markov chains that stay on a level.

A trajectory is the noise z of one episode, shape (steps, channels). It is requested when a
generator yields it in a batch. It was run when its robustness is sent back. If its episode errored,
NaN is sent, and the trajectory counts as not run.
"""

from collections.abc import Generator
from math import exp, prod, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenfail_services.statistics import batches

FIRST_STEP = 0.6
SMALLEST_STEP = 0.001

LARGE_SHARE = 0.2
"""Share of the moves that are at least as large as the first ones, whatever the acceptance. Small
ones alone do not leave an island of failures: on `rastrigin` of the known problems a run of 2,000
trajectories reached failures in 73 of 100 cases without large moves, in 98 with them."""


class Chains(NamedTuple):
    """Samples of one level: parallel Markov chains that start from samples of the level before.

    Attributes:
        z: shape (length, chains, steps, channels).
        values: robustness of the samples, shape (length, chains). [m]
        first_draw_of_chain: index of the independent first draw that each chain descends from,
            shape (chains,).
        acceptance: share of accepted moves; 1 without moves.
        ran: share of the draws from p(z) that did not error; 1 for moved samples.
    """

    z: batches.Array
    values: batches.Array
    first_draw_of_chain: NDArray[np.intp]
    acceptance: float = 1.0
    ran: float = 1.0


Sampling = Generator[batches.Batches, batches.Array, Chains]
"""Requests batches, and returns the samples of a level.

If episodes error (NaN), the samples represent the noise that can be run: draws are repeated, and a
chain whose move was not run stays at its place.
"""


class ChainGroup:
    """Chains that move together: all chains of a level, or some of them.

    Attributes:
        z: samples after each move, starts first, each of shape (chains, steps, channels).
        values: robustness of the samples, each of shape (chains,). [m]
        accepted: share of accepted proposals in each move.

    Args:
        z: the starts.
        values: their robustness.
    """

    def __init__(self, z: batches.Array, values: batches.Array) -> None:
        self.z = [z]
        self.values = [values]
        self.accepted: list[float] = []

    def move(
        self, proposed: batches.Array, robustness: batches.Array, accept: NDArray[np.bool_]
    ) -> None:
        """Move the chains with an accepted proposal; other chains stay."""
        self.z.append(np.where(accept[:, None, None], proposed, self.z[-1]))
        self.values.append(np.where(accept, robustness, self.values[-1]))


class ConditionalSampler:
    """Draws samples of z on each level, as Markov chains that start from samples on the level.

    Simultaneous draws cover the range of each value evenly. First draws are the points of a
    scrambled Sobol sequence, and the noise of a move of all chains is a Latin hypercube. Each draw
    alone is distributed as an independent draw, so the product of the shares over fixed levels
    stays unbiased. Its variance is smaller, especially if few values of the noise are decisive.
    Sobol points were not better for the moves: there are as many points as chains, a number that is
    small and rarely a power of two.

    Moves are preconditioned Crank–Nicolson's: z' = sqrt(1 − s²)·z + s·xi leaves the standard normal
    unchanged (Cotter et al. 2013, Statistical Science 28, 424–446). So a move is accepted if it
    stays on the level. The step s adapts to the acceptance (Papaioannou et al. 2015, Probabilistic
    Engineering Mechanics 41, 89–103), but one move in five has a large step.

    Chains move in groups. A group continues when its last move was run, independently of other
    groups. Groups share the step and the generator, which they use in the order of their moves.

    Args:
        rng: generator of every draw.
        acceptance: target share of accepted small moves, which the step adapts to.
        parallel: number of trajectories to run at a time; None for a single group of chains.

    Attributes:
        trajectories_requested: number of trajectories with an answer, NaN included.
        trajectories_run: number of trajectories with known robustness.
    """

    def __init__(
        self, rng: np.random.Generator, acceptance: float, parallel: int | None = None
    ) -> None:
        self._rng = rng
        self._acceptance = acceptance
        self._parallel = parallel
        self._step = FIRST_STEP
        self.trajectories_requested = 0
        self.trajectories_run = 0

    def draw_independent(self, samples: int, shape: batches.NoiseShape) -> Sampling:
        """Draw evenly spread samples from p(z), as chains of length 1."""
        z, values, requested = np.empty((0, *shape)), np.empty(0), 0
        while missing := samples - len(z):
            drawn = draw_sobol_normal(self._rng, missing, prod(shape)).reshape(missing, *shape)
            robustness = yield (drawn,)
            self._record(robustness)
            requested += missing
            ran = ~np.isnan(robustness)
            z, values = np.concatenate([z, drawn[ran]]), np.concatenate([values, robustness[ran]])
        return Chains(z[None], values[None], np.arange(samples), ran=samples / requested)

    def move_chains(
        self, above: Chains, threshold: float, starts: NDArray[np.intp], moves: int
    ) -> Sampling:
        """Draw samples at or below a threshold, in chains of 1 + `moves` samples per start.

        Args:
            above: samples of the level before.
            threshold: robustness that no sample may exceed. [m]
            starts: positions of the first samples among the samples of the level before; at least
                one.
            moves: number of moves of each chain; with 0, the starts are the samples.
        """
        z = above.z.reshape(above.values.size, *above.z.shape[2:])[starts]
        values = above.values.ravel()[starts]
        divided = batches.divide_chains(len(starts), self._parallel)
        groups = [ChainGroup(z[rows], values[rows]) for rows in divided]
        weight = 1.0 / len(groups)
        yield from batches.run_side_by_side(
            [self._move_group(group, threshold, moves, weight) for group in groups]
        )
        accepted = [share for group in groups for share in group.accepted]
        return Chains(
            np.concatenate([np.stack(group.z) for group in groups], axis=1),
            np.concatenate([np.stack(group.values) for group in groups], axis=1),
            above.first_draw_of_chain[starts % len(above.first_draw_of_chain)],
            float(np.mean(accepted)) if accepted else 1.0,
        )

    def _move_group(
        self, group: ChainGroup, threshold: float, moves: int, weight: float
    ) -> batches.Requests:
        """Move the chains of a group; `weight` is its share in the adaptation of the step."""
        for move in range(1, moves + 1):
            z = group.z[-1]
            large = self._rng.random(len(z)) < LARGE_SHARE
            proposed = self._propose(z, large)
            robustness = yield (proposed,)
            self._record(robustness)
            # False where robustness is NaN, so that the chain stays.
            group.move(proposed, robustness, robustness <= threshold)
            group.accepted.append(self._measure_acceptance(robustness, threshold))
            small = self._measure_acceptance(robustness[~large], threshold)
            self._adapt(small, move, weight)

    def _propose(self, z: batches.Array, large: NDArray[np.bool_]) -> batches.Array:
        step = np.where(large, max(self._step, FIRST_STEP), self._step)[:, None, None]
        noise = draw_latin_normal(self._rng, len(z), z[0].size).reshape(z.shape)
        proposed: batches.Array = np.sqrt(1.0 - step**2) * z + step * noise
        return proposed

    def _record(self, robustness: batches.Array) -> None:
        """Count trajectories with an answer."""
        self.trajectories_requested += len(robustness)
        self.trajectories_run += int(np.count_nonzero(~np.isnan(robustness)))

    def _measure_acceptance(self, robustness: batches.Array, threshold: float) -> float:
        """Return the share of moves that stay on the level; the target if no move was run."""
        known = robustness[~np.isnan(robustness)]
        return float((known <= threshold).mean()) if known.size else self._acceptance

    def _adapt(self, accepted: float, move: int, weight: float) -> None:
        """Increase the step if too many moves are accepted, and decrease it if too few are."""
        # Smaller and smaller changes, so that the step settles. A group has a part of the say,
        # by its share of the chains.
        change = exp(weight * (accepted - self._acceptance) / sqrt(move))
        self._step = min(max(self._step * change, SMALLEST_STEP), 1.0)


SOBOL_BITS = 30
"""Of the points of a Sobol sequence: each is the corner of a cell of this side, 2^-30."""


def draw_sobol_normal(rng: np.random.Generator, draws: int, size: int) -> batches.Array:
    """Return standard normal values from a scrambled Sobol sequence, shape (draws, size).

    Source: Owen 1998, ACM Transactions on Modeling and Computer Simulation 8 (1), 71–102.
    """
    # Imported late, as below: API and services import this module for the settings of `subset`, and
    # start in half a second less without scipy.
    from scipy.special import ndtri
    from scipy.stats.qmc import Sobol

    sequence = Sobol(size, bits=SOBOL_BITS, rng=rng)
    # The sequence is balanced in powers of two.
    points = sequence.random_base2((draws - 1).bit_length())[:draws]
    # Points are corners of cells, 0 among them, whose normal value would be infinite.
    inside = rng.random(points.shape) * 2.0**-SOBOL_BITS
    values: batches.Array = ndtri(points + inside)
    return values


def draw_latin_normal(rng: np.random.Generator, draws: int, size: int) -> batches.Array:
    """Return standard normal values from a Latin hypercube, shape (draws, size).

    Source: McKay, Beckman and Conover 1979, Technometrics 21 (2), 239–245.
    """
    from scipy.special import ndtri
    from scipy.stats.qmc import LatinHypercube

    values: batches.Array = ndtri(LatinHypercube(size, rng=rng).random(draws))
    return values


def find_starts(chains: Chains, threshold: float) -> NDArray[np.intp]:
    """Return the positions of the samples that reach a threshold, in row-major order."""
    return np.flatnonzero(chains.values <= threshold)
