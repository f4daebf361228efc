"""Maximum likelihood, cross-validation and the jackknife over the blocks of a log.

Records within a block depend on each other in ways that no model describes fully; blocks do not
depend on each other. So intervals come from the differences between blocks, and candidates are
compared on blocks that they were not fitted to. Blocks are tracks, or stretches of time.
"""

from collections.abc import Callable, Sequence
from math import exp
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from eigenfail.errors import InvalidValue
from eigenfail.values.estimates import Interval

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

FOLDS = 5
CONFIDENCE = 0.95

DIFFERENCE = 1e-4
"""Step of a numerical derivative, as a share of the parameter or of `FreeParameter.least_scale`,
whichever is larger."""

WORST_CONDITION = 1e6
"""Largest condition of the scaled curvature of the likelihood. Beyond it rounding errors of the
numerical derivatives decide, as where distances hardly differ and only sigma as a whole is told."""

MOST_SPREADS = 50.0
"""Most widths of its interval, as logarithms, by which a positive parameter may be wrong."""


BOUND_TOLERANCE = 1e-3
"""A parameter so near to a bound, relative to that, would go beyond it."""

LEAST_GAIN = 1e-6
"""Smallest gain in log density that counts: below it, it is the rounding of the optimizer."""


class FreeParameter(NamedTuple):
    """A parameter that is fitted.

    Attributes:
        name: its name in the model.
        bounds: smallest and largest value.
        start: start value of the search.
        unit: divisor of the parameter in the search, so that all parameters have one order of
            magnitude.
        is_scale: whether its logarithm is nearer to normal than itself.
        is_inverse: whether the model has the inverse of the fitted value.
        least_scale: see `DIFFERENCE`.
    """

    name: str
    bounds: tuple[float, float]
    start: float
    unit: float = 1.0
    is_scale: bool = False
    is_inverse: bool = False
    least_scale: float = 1e-2


class Likelihood(NamedTuple):
    """The likelihood that a fit maximizes.

    Attributes:
        parameters: the fitted parameters.
        compute_density: log density of each record, shape (n,), from the parameters.
        block: number of the block of each record, shape (n,).
        blocks: number of blocks.
        undetermined: problem of the log, and remedy, for the error if the likelihood is flat.
    """

    parameters: tuple[FreeParameter, ...]
    compute_density: Callable[[Array], Array]
    block: Integers
    blocks: int
    undetermined: tuple[str, str]

    def sum_by_block(self, values: Array) -> Array:
        """Return the sums of values of the records, shape (n,), over each block."""
        return np.bincount(self.block, values, self.blocks).astype(np.float64)


class Parameter(msgspec.Struct, frozen=True):
    """A fitted parameter by its name in the model, with its 95 % interval."""

    name: str
    value: float
    interval: Interval


def list_bounded(likelihood: Likelihood, best: Array) -> list[str]:
    """Return the parameters that lie on a bound of the search, with this bound.

    Bounds of 0 are left out: a model may well have a slope or a correlation of 0.
    """
    bounded = []
    for free, value in zip(likelihood.parameters, best.tolist(), strict=True):
        for bound in free.bounds:
            if bound and abs(value - bound) <= BOUND_TOLERANCE * abs(bound):
                shown = 1.0 / bound if free.is_inverse else bound
                bounded.append(f"{free.name} lies on its bound, {shown:.3g}")
    return bounded


def maximize_likelihood(likelihood: Likelihood, held_out: Array | None = None) -> Array:
    """Return the parameters of largest likelihood.

    Args:
        likelihood: the likelihood to maximize.
        held_out: records that do not count, shape (n,).
    """
    counted = np.ones(len(likelihood.block)) if held_out is None else np.where(held_out, 0.0, 1.0)
    total = counted.sum()
    unit = np.array([one.unit for one in likelihood.parameters])
    start = np.array([one.start for one in likelihood.parameters])
    bounds = np.array([one.bounds for one in likelihood.parameters])

    def find_loss(scaled: Array) -> float:
        return float(-(counted * likelihood.compute_density(scaled * unit)).sum() / total)

    found = optimize.minimize(
        find_loss,
        start / unit,
        method="L-BFGS-B",
        bounds=bounds / unit[:, None],
        options={"ftol": 1e-12, "gtol": 1e-8, "maxiter": 500},
    )
    best: Array = found.x * unit
    return best


def cross_validate(likelihood: Likelihood) -> Array:
    """Return log densities summed over each block, from fits to the blocks of all other folds."""
    score = np.zeros(likelihood.blocks)
    fold = np.arange(likelihood.blocks) % FOLDS
    for held in range(FOLDS):
        is_held = fold == held
        best = maximize_likelihood(likelihood, is_held[likelihood.block])
        score[is_held] = likelihood.sum_by_block(likelihood.compute_density(best))[is_held]
    return score


def estimate_parameters(likelihood: Likelihood, best: Array) -> tuple[Parameter, ...]:
    """Return the parameters of largest likelihood with the intervals of the jackknife over blocks.

    Each fit without one block is approximated by a step of Newton's method from that with all.

    Raises:
        InvalidValue: the log does not determine all parameters.
    """
    blocks = likelihood.blocks
    scores, curvatures = _differentiate(likelihood, best)
    total = curvatures.sum(axis=0)
    _refuse_undetermined(likelihood, total)
    moves = np.linalg.solve(total - curvatures, scores[..., None])[..., 0]
    deviation = np.sqrt((blocks - 1) / blocks * np.square(moves).sum(axis=0))
    reach = float(stats.t.ppf(0.5 + CONFIDENCE / 2.0, blocks - 1)) * deviation
    return tuple(
        _make_parameter(one, float(value), float(room))
        for one, value, room in zip(likelihood.parameters, best, reach, strict=True)
    )


def _refuse_undetermined(likelihood: Likelihood, curvature: Array) -> None:
    """Refuse a likelihood that is flat in some direction.

    Raises:
        InvalidValue: it is.
    """
    scale = np.sqrt(np.abs(np.diag(curvature)))
    if not scale.all() or np.linalg.cond(curvature / np.outer(scale, scale)) > WORST_CONDITION:
        raise InvalidValue("log", *likelihood.undetermined)


def _make_parameter(free: FreeParameter, value: float, reach: float) -> Parameter:
    low, high = value - reach, value + reach
    if free.is_scale:
        ratio = min(reach / value, MOST_SPREADS)
        low, high = value * exp(-ratio), value * exp(ratio)
    low, high = max(low, free.bounds[0]), min(high, free.bounds[1])
    if free.is_inverse:
        return Parameter(free.name, 1.0 / value, Interval(1.0 / high, 1.0 / low))
    return Parameter(free.name, value, Interval(low, high))


def _differentiate(likelihood: Likelihood, at: Array) -> tuple[Array, Array]:
    """Return slopes and curvatures of each block's log likelihood, by central differences.

    Args:
        likelihood: the likelihood to differentiate.
        at: parameters; on a bound, the derivatives are taken just inside it.

    Returns:
        Shapes (blocks, parameters) and (blocks, parameters, parameters).
    """
    limits = np.array([one.bounds for one in likelihood.parameters])
    least = np.array([one.least_scale for one in likelihood.parameters])
    step = DIFFERENCE * np.maximum(np.abs(at), least)
    best = np.clip(at, limits[:, 0] + step, limits[:, 1] - step)
    unit = np.diag(step)

    def sum_density(parameters: Array) -> Array:
        return likelihood.sum_by_block(likelihood.compute_density(parameters))

    count = len(best)
    slopes = np.zeros((likelihood.blocks, count))
    curvatures = np.zeros((likelihood.blocks, count, count))
    middle = sum_density(best)
    ahead = [sum_density(best + unit[i]) for i in range(count)]
    behind = [sum_density(best - unit[i]) for i in range(count)]
    for i in range(count):
        slopes[:, i] = (ahead[i] - behind[i]) / (2.0 * step[i])
        curvatures[:, i, i] = (ahead[i] - 2.0 * middle + behind[i]) / step[i] ** 2
        for j in range(i):
            mixed = (
                sum_density(best + unit[i] + unit[j])
                - sum_density(best + unit[i] - unit[j])
                - sum_density(best - unit[i] + unit[j])
                + sum_density(best - unit[i] - unit[j])
            )
            curvatures[:, i, j] = curvatures[:, j, i] = mixed / (4.0 * step[i] * step[j])
    return slopes, curvatures


class ShapeScore(msgspec.Struct, frozen=True):
    """How well a candidate describes blocks that it was not fitted to.

    Attributes:
        held_out: log density of a record, mean over the log.
        gain: `held_out` less its value for the simplest candidate, with the interval of the
            difference; None for the simplest candidate.
    """

    held_out: float
    gain: tuple[float, Interval] | None

    @property
    def is_better(self) -> bool:
        """True if the interval of the gain is above 0, by more than rounding errors."""
        return self.gain is not None and self.gain[1].low > LEAST_GAIN


def compare_candidates(likelihoods: Sequence[Likelihood]) -> list[ShapeScore]:
    """Return the scores of candidates for the same records; the first one is the simplest."""
    first = likelihoods[0]
    counts = first.sum_by_block(np.ones(len(first.block)))
    scores = [cross_validate(one) for one in likelihoods]
    return [
        ShapeScore(
            float(score.sum() / counts.sum()),
            None if score is scores[0] else find_ratio_interval(score - scores[0], counts),
        )
        for score in scores
    ]


def find_ratio_interval(
    sums: Array, counts: Array, confidence: float = CONFIDENCE
) -> tuple[float, Interval]:
    """Return the mean of what blocks sum up, and its interval by the jackknife over blocks.

    Args:
        sums: sum of the values of each block, shape (blocks,).
        counts: number of values of each block, shape (blocks,); those without any do not count.
        confidence: probability that the interval holds the mean.
    """
    sums, counts = sums[counts > 0.0], counts[counts > 0.0]
    blocks = len(sums)
    mean = float(sums.sum() / counts.sum())
    left = (sums.sum() - sums) / (counts.sum() - counts)
    deviation = np.sqrt((blocks - 1) / blocks * np.square(left - mean).sum())
    reach = float(stats.t.ppf(0.5 + confidence / 2.0, blocks - 1) * deviation)
    return mean, Interval(mean - reach, mean + reach)


def widen_share(interval: Interval, k: int, n: int, confidence: float = CONFIDENCE) -> Interval:
    """Return an interval with the exact one of k of n independent cases (Clopper and Pearson 1934).

    The interval of the jackknife alone has zero width if no case occurred.
    """
    error = 0.5 * (1.0 - confidence)
    low = float(stats.beta.ppf(error, k, n - k + 1)) if k else 0.0
    high = float(stats.beta.ppf(1.0 - error, k + 1, n - k)) if k < n else 1.0
    return Interval(min(interval.low, low), max(interval.high, high))
