"""The probability of a rare failure by subset simulation (Au and Beck 2001).

P(r <= 0) = P(r <= b_1) · P(r <= b_2 | r <= b_1) · … with levels b_1 > b_2 > … of robustness r, each
low enough that a fixed share of the samples on the level before reaches it.
Source: Probabilistic Engineering Mechanics 16 (4), 263–277.
"""

from collections.abc import Callable, Generator, Sequence
from enum import StrEnum
from math import ceil, exp, inf, prod, sqrt
from typing import Annotated, NamedTuple

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from eigenfail.errors import InvalidValue
from eigenfail.values import Interval
from eigenfail_services.statistics.intervals import log_normal

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

Where z could not be run its robustness is NaN. The samples are then of the noise that can be run:
draws are made anew, and a chain whose move could not be run stays where it is.
"""


class ConditionalSampler:
    """Draws `samples` of z on each level, as Markov chains from a share of them.

    Moves are preconditioned Crank–Nicolson's: z' = sqrt(1 − s²)·z + s·xi leaves the standard normal
    unchanged (Cotter et al. 2013, Statistical Science 28, 424–446), so that a move is accepted
    wherever it stays on the level. The step s follows the acceptance (Papaioannou et al. 2015,
    Probabilistic Engineering Mechanics 41, 89–103).

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


class SubsetSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of a subset simulation."""

    samples: Annotated[int, Meta(ge=20, le=1_000_000, description="samples on each level")] = 2000
    share: Annotated[
        float, Meta(ge=0.05, le=0.5, description="share of them that is to reach the next level")
    ] = 0.1
    acceptance: Annotated[
        float, Meta(ge=0.1, le=0.9, description="share of the moves that is to be accepted")
    ] = 0.4
    most_levels: Annotated[int, Meta(ge=1, le=100, description="levels at most")] = 20


class SubsetEnd(StrEnum):
    """Why a subset simulation ended."""

    REACHED = "failures were reached"
    STALLED = "robustness falls no further"
    SPENT = "all levels were spent"


class SubsetLevel(msgspec.Struct, frozen=True):
    """One level.

    Attributes:
        threshold: robustness at or below which a sample is on it.
        share: probability of that, given the level before.
        variation: coefficient of variation of `share`.
        acceptance: share of the moves that were accepted on the level before; 1 on the first.
    """

    threshold: float
    share: float
    variation: float
    acceptance: float


class SubsetEstimate(msgspec.Struct, frozen=True, kw_only=True):
    """What a subset simulation found.

    Attributes:
        probability: probability of a failure; None if none was reached: failures are rarer then
            than the product of the levels' shares.
        variation: coefficient of variation of that product.
        interval: 95 %, log-normal around `probability`; None without it. It knows nothing of a kind
            of failure of which no sample showed the beginning.
        ancestors: how many of the first, independent samples the failures descend from.
        evaluations: how often robustness was evaluated.
    """

    probability: float | None
    variation: float
    interval: Interval | None
    ancestors: int
    evaluations: int
    levels: tuple[SubsetLevel, ...]
    end: SubsetEnd


Robustness = Callable[[Array], Array]
"""Robustness of a batch of noise z, shape (n, steps, 2): n finite numbers."""


class SubsetSimulation:
    """P(robustness <= 0) for noise z, shape (steps, 2), of independent standard normal values.

    The same seed and robustness give the same estimate.

    Attributes:
        levels: those that are known so far.
        chains: the samples of the last level, once failures were reached; None before that.
    """

    def __init__(self, steps: int, settings: SubsetSettings, seed: int | Sequence[int]) -> None:
        self._steps = steps
        self._settings = settings
        self._sampler = ConditionalSampler(np.random.default_rng(seed), settings.acceptance)
        self.levels: list[SubsetLevel] = []
        self.chains: Chains | None = None

    @property
    def evaluations(self) -> int:
        """How many z were run so far."""
        return self._sampler.evaluations

    def run(self) -> Generator[Array, Array, SubsetEstimate]:
        """Yields noise and is sent its robustness, NaN where it could not be run; see `Sampling`.

        To be run once.
        """
        settings, levels, sampler = self._settings, self.levels, self._sampler
        chains = yield from sampler.independent(settings.samples, self._steps)
        threshold = _find_next_threshold(chains.values, inf, settings.share)
        while threshold is not None and len(levels) < settings.most_levels:
            levels.append(make_level(chains, threshold))
            if threshold <= 0.0:
                self.chains = chains
                return estimate_from_failures(levels, chains, sampler.evaluations)
            most = round(settings.share * settings.samples)
            chains = yield from sampler.below(threshold, chains, most)
            threshold = _find_next_threshold(chains.values, threshold, settings.share)
        end = SubsetEnd.STALLED if threshold is None else SubsetEnd.SPENT
        return estimate_without_failures(levels, end, sampler.evaluations)


def subset_simulation(
    robustness: Robustness, steps: int, settings: SubsetSettings, seed: int
) -> SubsetEstimate:
    """A whole `SubsetSimulation` whose robustness is a function.

    Raises:
        InvalidValue: robustness is not finite, or not one value for each trajectory.
    """
    running = SubsetSimulation(steps, settings, seed).run()
    z = next(running)
    while True:
        try:
            z = running.send(evaluate_robustness(robustness, z))
        except StopIteration as end:
            found: SubsetEstimate = end.value
            return found


def evaluate_robustness(robustness: Robustness, z: Array) -> Array:
    """The robustness of each z.

    Raises:
        InvalidValue: it is not finite, or not one value for each.
    """
    values = np.asarray(robustness(z), np.float64)
    if values.shape != z.shape[:1] or not np.isfinite(values).all():
        raise InvalidValue(
            "robustness",
            f"{len(z)} trajectories gave values of shape {values.shape}, or not finite ones.",
            "Return one finite number for each trajectory.",
        )
    return values


def _find_next_threshold(values: Array, before: float, share: float) -> float | None:
    """The robustness that this share of the values reaches, never below 0.

    Where ties hold that quantile up at the level before, the next smaller value; None without one.
    """
    ordered = np.sort(values, axis=None)
    quantile = float(ordered[ceil(share * ordered.size) - 1])
    if quantile >= before:
        smaller = ordered[ordered < before]
        if not smaller.size:
            return None
        quantile = float(smaller[-1])
    return max(quantile, 0.0)


def make_level(chains: Chains, threshold: float) -> SubsetLevel:
    """What the samples say about a level."""
    inside = chains.values <= threshold
    return SubsetLevel(
        threshold, float(inside.mean()), _estimate_variation(inside), chains.acceptance
    )


def _estimate_variation(inside: NDArray[np.bool_]) -> float:
    """Coefficient of variation of a share that chains have found, shape (length, chains).

    sqrt((1 − p) / (p·n) · (1 + gamma)), gamma = 2·sum_k (1 − k/length)·R(k)/R(0), where R(k) is the
    covariance of two samples k moves apart in a chain (Au and Beck 2001).
    """
    length, p = len(inside), float(inside.mean())
    if p == 1.0:
        return 0.0
    together = [np.mean(inside[:-k] & inside[k:]) for k in range(1, length)]
    covariances = np.array(together) - p * p
    remaining = 1.0 - np.arange(1, length) / length
    gamma = 2.0 * float(remaining @ covariances) / (p * (1.0 - p))
    return sqrt((1.0 - p) / (p * inside.size) * (1.0 + max(gamma, 0.0)))


def combine_variations(levels: Sequence[SubsetLevel]) -> float:
    """Coefficient of variation of the product of the shares, if they were independent."""
    return sqrt(sum(one.variation**2 for one in levels))


def estimate_lineage_variation(descendants: NDArray[np.number]) -> float:
    """Coefficient of variation of an estimate, from how the failures descend from the first draws.

    sqrt(sum d²) / sum d for d failures from each first draw: the fewer they descend from, the more
    it is a matter of luck that these were drawn (Lee and Whiteley 2018, Biometrika 105, 609–625).
    """
    return float(np.linalg.norm(descendants) / descendants.sum())


def estimate_from_failures(
    levels: Sequence[SubsetLevel], chains: Chains, evaluations: int
) -> SubsetEstimate:
    """The estimate once failures were reached, with its log-normal interval.

    The larger of the two variations counts: Au and Beck's takes the levels as independent, which
    they are not, for the seeds of a level are samples of the one before.
    """
    failures = (chains.values <= 0.0).sum(axis=0)
    descendants = np.bincount(chains.ancestors, failures)
    probability = prod(one.share for one in levels)
    cv = max(combine_variations(levels), estimate_lineage_variation(descendants))
    return SubsetEstimate(
        probability=probability,
        variation=cv,
        interval=log_normal(probability, cv),
        ancestors=int(np.count_nonzero(descendants)),
        evaluations=evaluations,
        levels=tuple(levels),
        end=SubsetEnd.REACHED,
    )


def estimate_without_failures(
    levels: Sequence[SubsetLevel], end: SubsetEnd, evaluations: int
) -> SubsetEstimate:
    """Return the estimate of simulations that reached no failure."""
    return SubsetEstimate(
        probability=None,
        variation=combine_variations(levels),
        interval=None,
        ancestors=0,
        evaluations=evaluations,
        levels=tuple(levels),
        end=end,
    )
