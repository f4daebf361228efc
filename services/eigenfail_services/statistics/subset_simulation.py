"""The probability of a rare failure by subset simulation (Au and Beck 2001).

P(r <= 0) = P(r <= b_1) · P(r <= b_2 | r <= b_1) · … with levels b_1 > b_2 > … of robustness r, each
low enough that a fixed share of the samples on the level before reaches it.
Source: Probabilistic Engineering Mechanics 16 (4), 263–277.
"""

from collections.abc import Callable, Generator, Sequence
from math import ceil, inf, prod, sqrt

import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import InvalidValue
from eigenfail_services.statistics.conditional_sampling import (
    Array,
    Chains,
    ConditionalSampler,
)
from eigenfail_services.statistics.intervals import log_normal
from eigenfail_services.statistics.subset_estimate import (
    End,
    Level,
    SubsetEstimate,
    SubsetSettings,
)

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
        self.levels: list[Level] = []
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
        threshold = next_threshold(chains.values, inf, settings.share)
        while threshold is not None and len(levels) < settings.most_levels:
            levels.append(level(chains, threshold))
            if threshold <= 0.0:
                self.chains = chains
                return reached(levels, chains, sampler.evaluations)
            most = round(settings.share * settings.samples)
            chains = yield from sampler.below(threshold, chains, most)
            threshold = next_threshold(chains.values, threshold, settings.share)
        end = End.STALLED if threshold is None else End.SPENT
        return not_reached(levels, end, sampler.evaluations)


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
            z = running.send(evaluated(robustness, z))
        except StopIteration as end:
            found: SubsetEstimate = end.value
            return found


def evaluated(robustness: Robustness, z: Array) -> Array:
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


def next_threshold(values: Array, before: float, share: float) -> float | None:
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


def level(chains: Chains, threshold: float) -> Level:
    """What the samples say about a level."""
    inside = chains.values <= threshold
    return Level(threshold, float(inside.mean()), variation(inside), chains.acceptance)


def variation(inside: NDArray[np.bool_]) -> float:
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


def product_variation(levels: Sequence[Level]) -> float:
    """Coefficient of variation of the product of the shares, if they were independent."""
    return sqrt(sum(one.variation**2 for one in levels))


def lineage_variation(descendants: NDArray[np.number]) -> float:
    """Coefficient of variation of an estimate, from how the failures descend from the first draws.

    sqrt(sum d²) / sum d for d failures from each first draw: the fewer they descend from, the more
    it is a matter of luck that these were drawn (Lee and Whiteley 2018, Biometrika 105, 609–625).
    """
    return float(np.linalg.norm(descendants) / descendants.sum())


def reached(levels: Sequence[Level], chains: Chains, evaluations: int) -> SubsetEstimate:
    """The estimate once failures were reached, with its log-normal interval.

    The larger of the two variations counts: Au and Beck's takes the levels as independent, which
    they are not, for the seeds of a level are samples of the one before.
    """
    failures = (chains.values <= 0.0).sum(axis=0)
    descendants = np.bincount(chains.ancestors, failures)
    probability = prod(one.share for one in levels)
    cv = max(product_variation(levels), lineage_variation(descendants))
    return SubsetEstimate(
        probability=probability,
        variation=cv,
        interval=log_normal(probability, cv),
        ancestors=int(np.count_nonzero(descendants)),
        evaluations=evaluations,
        levels=tuple(levels),
        end=End.REACHED,
    )


def not_reached(levels: Sequence[Level], end: End, evaluations: int) -> SubsetEstimate:
    """What is left to say where no failure was reached."""
    return SubsetEstimate(
        probability=None,
        variation=product_variation(levels),
        interval=None,
        ancestors=0,
        evaluations=evaluations,
        levels=tuple(levels),
        end=end,
    )
